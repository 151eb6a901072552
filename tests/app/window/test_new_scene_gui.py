"""From a folder to a scene whose objects can be clicked, without a terminal."""

import shutil
import time

import pytest
from window_driver import PATIENCE, editor_window

from instdrive_core.datasets.synthetic.config import StreetConfig
from instdrive_core.datasets.synthetic.write import write_street
from instdrive_core.formats.folder.scenes import read_scene_folder

SHORTEST = "0.1"
"""Minutes: the fewest steps that are trained."""
TRAINING_PATIENCE = 3 * PATIENCE


@pytest.fixture(scope="module")
def street(tmp_path_factory):
    """A small street of five steps, of which step 4 is held out."""
    folder = tmp_path_factory.mktemp("new") / "drive"
    write_street(folder, StreetConfig(seed=3, steps=5, width=64, height=36, lidar_azimuths=200))
    return folder


@pytest.fixture
def window(tmp_path):
    """The editor without a scene."""
    broken = tmp_path / "broken.ply"
    broken.write_bytes(b"no scene at all")
    with editor_window(broken, tmp_path, opens=False) as driver:
        driver.wait_for_message("broken.ply")
        yield driver


def enter(window, field, text):
    window.click_widget(field)
    window.key("ctrl+a")
    window.type(text)


@pytest.mark.gui
def test_a_folder_becomes_a_scene_to_click_in(window, street, tmp_path):
    run = tmp_path / "made"
    window.click_widget("empty.new")
    enter(window, "new.source", str(street))
    window.wait_for_widget("new.found")
    enter(window, "new.minutes", SHORTEST)
    enter(window, "new.out", str(run))
    window.click_widget("dialog.accept")
    window.wait_for_widget("training.status.running")
    window.click_widget("training.Pause")
    window.wait_for_widget("training.status.paused")
    window.click_widget("training.Go on")
    seen = window.wait_for(lambda state: "training.picture" in state["widgets"], "the live picture", TRAINING_PATIENCE)
    assert "training.curve.Loss" in seen["widgets"] or not seen["open"]
    window.wait_for(lambda state: state["open"], "the scene that was made", TRAINING_PATIENCE)
    window.wait_for_widget("training.Report")
    window.wait_until_calm()
    assert (run / "report.html").is_file()
    click_an_object(window)
    assert window.quit() == 0


def click_an_object(window):
    """Click here and there in the picture until something is selected."""
    left, top, right, bottom = window.wait_for_rect("picture")
    for across, down in ((0.5, 0.6), (0.35, 0.55), (0.65, 0.55), (0.25, 0.5), (0.75, 0.5), (0.5, 0.8)):
        window.click(left + across * (right - left), top + down * (bottom - top))
        if window.wait_until_calm()["selected"]:
            return
    raise AssertionError("nothing can be clicked")
