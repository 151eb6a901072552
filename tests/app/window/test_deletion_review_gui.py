"""What a deletion left, seen and cleaned up in the real window."""

import pytest
from parked_street import CAR, parked_street
from window_driver import editor_window

from instdrive_core.formats.registry import save_scene

pytestmark = pytest.mark.gui


@pytest.fixture
def window(tmp_path):
    """The window on a street with one parked car, its strays and its hole."""
    save_scene(tmp_path / "parked", parked_street().scene)
    with editor_window(tmp_path / "parked", tmp_path) as driver:
        yield driver


def test_residue_is_absorbed_and_the_hole_filled_by_clicks(window):
    window.click_widget(f"instances.{CAR}")
    window.wait_for_selection(CAR)
    window.key("Delete")
    told = window.wait_for(lambda state: "residue" in state["messages"][-1], "the report")
    assert told["messages"][-1].startswith("Deleted Car 7: 40 splats of residue, hole of ")
    widgets = window.wait_until_calm()["widgets"]
    box, picture = widgets["deletion review"], widgets["picture"]
    assert picture[0] < box[0] < box[2] < picture[2]
    assert picture[1] < box[1] < box[3] < picture[3]
    for name in ("deletion.absorb", "deletion.fill", "deletion.clear"):
        left, top, right, bottom = widgets[name]
        assert box[0] < left < right < box[2], name
        assert box[1] < top < bottom < box[3], name
    window.click_widget("deletion.absorb")
    window.wait_for_edit("Absorb floaters of Car 7")
    state = window.wait_for(lambda state: "deletion.absorb" not in state["widgets"], "the residue to be gone")
    assert state["selected"] == [], "the click was not for the picture"
    button = window.wait_for_widget("deletion.fill")
    assert state["widgets"]["deletion.fill"] == widgets["deletion.fill"], "the other button is still under the mouse"
    window.hasty_drag(button, button)  # the press goes to the button, not to what the mouse has left in that frame
    window.wait_for_edit("Fill hole of ")
    window.wait_for(lambda state: "deletion review" not in state["widgets"], "the box to be gone")
    window.key("ctrl+z")
    window.wait_for(lambda state: "deletion.fill" in state["widgets"], "undo to bring the hole back")
    window.click_widget("deletion.clear")
    window.wait_for(lambda state: "deletion review" not in state["widgets"], "the box to be dismissed")
    assert window.quit() == 0
