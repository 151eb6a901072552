"""Box, ruler and grid in the real window, with true mouse events and keys."""

import pytest
from procedural_street import FIRST_CAR
from test_region_tools_gui import RED_CAR_SIDE

pytestmark = pytest.mark.gui

BLUE_CAR_SIDE = (2.1, 7.6, 0.8)


def test_a_box_is_placed_dragged_and_crops_and_a_line_is_measured(window):
    window.key("z")
    window.wait_for(lambda state: state["tool"] == "box", "Z to take the box")
    start = window.wait_until_calm()
    window.click(*window.pixel_of(RED_CAR_SIDE))
    placed = window.wait_for(lambda state: state["box"], "the box")["box"]
    window.tap("Return")
    window.wait_for_selection(FIRST_CAR)
    x, y = window.wait_for_widget("gizmo.box.z+")
    window.drag((x, y), (x, y - 40))
    state = window.wait_for(lambda state: state["box"][5] > placed[5] + 0.1, "the upper face to rise")
    assert state["camera"] == start["camera"], "the drag moved the camera"
    window.key("shift+z")
    window.wait_for_edit("Crop to the box")
    window.click_widget("box.delete_outside")
    state = window.wait_for_edit("Delete ")
    assert state["visible"] == [FIRST_CAR]
    for _ in range(2):
        window.key("ctrl+z")
    window.wait_for(lambda state: len(state["visible"]) > 5, "undo to bring everything back")
    window.key("BackSpace")
    window.wait_for(lambda state: state["box"] is None, "Backspace to remove the box")

    window.key("m")
    window.wait_for(lambda state: state["tool"] == "measure", "M to take the ruler")
    for place in (RED_CAR_SIDE, BLUE_CAR_SIDE):
        window.click(*window.pixel_of(place))
    state = window.wait_for(lambda state: state["measured"], "two clicks to measure")
    assert 3.0 < float(state["measured"].split()[0]) < 8.0
    selected = state["selected"]
    window.key("Escape")
    state = window.wait_for(lambda state: not state["measured"], "Escape to take the line away")
    assert state["selected"] == selected, "the selection stays"
    window.key("shift+g")
    window.wait_until_calm()
    assert window.quit() == 0
