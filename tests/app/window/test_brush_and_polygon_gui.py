"""Brush and polygon in the real window, with true mouse events and keys."""

import pytest
from procedural_street import FIRST_CAR
from test_region_tools_gui import RED_BOX, outline

pytestmark = pytest.mark.gui


def test_brush_and_polygon_select_delete_and_undo(window):
    left, top, right, bottom = outline(window, RED_BOX)
    middle, bottom = (top + bottom) / 2, bottom - 20
    window.key("x")
    window.wait_for(lambda state: state["tool"] == "brush", "X to take the brush")
    start = window.state["camera"]["world_from_camera"]
    window.key("bracketleft")
    window.drag((left + 10, middle), (right - 10, middle))
    state = window.wait_for(lambda state: FIRST_CAR in state["selected"], "the brush to select the car")
    assert state["camera"]["world_from_camera"] == start, "the stroke moved the camera"
    window.click_widget("tool.single_splats")
    window.drag((left + 10, middle), (right - 10, middle))
    part = window.wait_for(lambda state: state["history"][-1].endswith("splats"), "splats to be painted")
    window.key("Delete")
    window.wait_for_edit("Delete selection")
    window.key("ctrl+z")
    window.wait_for(lambda state: state["selected_splats"] == part["selected_splats"], "undo")

    window.click_widget("tool.polygon")
    window.wait_for(lambda state: state["tool"] == "polygon", "the toolbar to give the polygon")
    steps = window.state["cursor"]
    for corner in ((left, top), (right, top)):
        window.click(*corner)
    window.key("Escape")
    assert window.wait_until_calm()["cursor"] == steps, "Escape gives up the polygon, not the selection"
    for corner in ((left, top), (right, top), (right, bottom), (left, bottom)):
        window.click(*corner)
    window.tap("Return")
    state = window.wait_for(lambda state: state["cursor"] == steps + 1, "the polygon to select")
    assert FIRST_CAR in state["selected"]
    assert window.quit() == 0
