"""What a deletion left, seen and cleaned up in the real window."""

import shutil

import pytest
from parked_street import CAR, parked_street
from window_driver import WindowDriver

from instdrive_app.virtual_display import virtual_display
from instdrive_core.formats.registry import save_scene

pytestmark = pytest.mark.gui


@pytest.fixture
def window(tmp_path):
    """An editor window that has opened the street."""
    for tool in ("Xvfb", "xdotool"):
        if shutil.which(tool) is None:
            pytest.skip(f"{tool} is not installed")
    save_scene(tmp_path / "parked", parked_street().scene)
    with virtual_display((1280, 720)):
        driver = WindowDriver(tmp_path / "parked", tmp_path)
        try:
            driver.wait_for(lambda state: state["open"] and state["settled"], "the scene to be open")
            yield driver
        finally:
            driver.close()


def last_edit(window, beginning):
    def is_last(state):
        return state["cursor"] == len(state["history"]) > 0 and state["history"][-1].startswith(beginning)

    return window.wait_for(is_last, beginning)


def test_residue_is_absorbed_and_the_hole_filled_by_clicks(window):
    window.click_widget(f"instances.{CAR}")
    window.wait_for(lambda state: state["selected"] == [CAR], "the row to select")
    window.key("Delete")
    told = window.wait_for(lambda state: "residue" in state["messages"][-1], "the report")
    assert told["messages"][-1].startswith("Deleted Car 7: 40 splats of residue, hole of ")
    widgets = window.wait_until_calm()["widgets"]
    box, picture = widgets["aftermath"], widgets["picture"]
    assert picture[0] < box[0] < box[2] < picture[2]
    assert picture[1] < box[1] < box[3] < picture[3]
    for name in ("aftermath.absorb", "aftermath.fill", "aftermath.clear"):
        left, top, right, bottom = widgets[name]
        assert box[0] < left < right < box[2], name
        assert box[1] < top < bottom < box[3], name
    window.click_widget("aftermath.absorb")
    last_edit(window, "Absorb floaters of instance 7")
    state = window.wait_for(lambda state: "aftermath.absorb" not in state["widgets"], "the residue to be gone")
    assert state["selected"] == [], "the click was not for the picture"
    window.click_widget("aftermath.fill")
    last_edit(window, "Fill hole of ")
    window.wait_for(lambda state: "aftermath" not in state["widgets"], "the box to be gone")
    window.key("ctrl+z")
    window.wait_for(lambda state: "aftermath.fill" in state["widgets"], "undo to bring the hole back")
    window.click_widget("aftermath.clear")
    window.wait_for(lambda state: "aftermath" not in state["widgets"], "the box to be dismissed")
    assert window.quit() == 0
