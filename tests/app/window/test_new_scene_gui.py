"""From a folder to a scene whose objects can be clicked, without a terminal."""

from contextlib import contextmanager

import pytest
from window_driver import PATIENCE, WindowDriver, editor_display
from written_street import TINY, copy_street

SHORTEST = "0.1"
"""Minutes: the fewest steps that are trained."""
TRAINING_PATIENCE = 3 * PATIENCE


@pytest.fixture(scope="module")
def street(tmp_path_factory):
    """A small street of five steps, of which step 4 is held out."""
    return copy_street(TINY, tmp_path_factory.mktemp("new") / "drive", tmp_path_factory)


@contextmanager
def empty_editor(folder, name):
    """An editor without a scene; all of one test share what the editor remembers."""
    broken = folder / name / "broken.ply"
    broken.parent.mkdir()
    broken.write_bytes(b"no scene at all")
    driver = WindowDriver(broken, broken.parent, state=folder / "state")
    try:
        driver.wait_for_message("broken.ply")
        yield driver
    finally:
        driver.close()


def enter(window, field, text):
    window.click_widget(field)
    window.key("ctrl+a")
    window.type(text)


@pytest.mark.slow
@pytest.mark.gui
def test_a_folder_becomes_a_scene_to_click_in(street, tmp_path):
    run = tmp_path / "made"
    with editor_display():
        with empty_editor(tmp_path, "first") as window:
            window.click_widget("empty.new")
            enter(window, "new.source", str(street))
            window.wait_for_widget("new.found")
            enter(window, "new.minutes", SHORTEST)
            enter(window, "new.out", str(run))
            window.click_widget("dialog.accept")
            window.wait_for_widget("training.status.running")
            window.click_widget("training.Pause")
            window.wait_for_widget("training.status.paused")
            window.key("ctrl+q")
            window.click_widget("question.Go on in the background")
            assert window.wait_for_end() == 0
        with empty_editor(tmp_path, "second") as window:
            shown = ("training.Stop", "training.Open the scene")  # it may be done by now
            window.wait_for(lambda state: any(name in state["widgets"] for name in shown), "the job to be found again")
            window.wait_for(lambda state: "training.Open the scene" in state["widgets"], "its end", TRAINING_PATIENCE)
            assert {"training.picture", "training.curve.PSNR (dB)"} <= set(window.state["widgets"])
            window.click_widget("training.Open the scene")
            window.wait_until_open()
            assert (run / "report.html").is_file()
            assert "training.Report" in window.state["widgets"]
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
