"""Flood and eyedropper in the real window: toolbar, keys, clicks."""

import pytest
from procedural_street import FIRST_CAR
from test_region_tools_gui import RED_CAR_SIDE

pytestmark = pytest.mark.gui


def test_a_click_selects_what_is_like_the_splat_below_it(window):
    window.click_widget("tool.flood")
    window.wait_for(lambda state: state["tool"] == "flood", "the toolbar to give the flood")
    window.click(*window.pixel_of(RED_CAR_SIDE))
    flooded = window.wait_for(lambda state: state["selected_splats"] > 10, "the flood to select")
    assert flooded["selected"] == [FIRST_CAR]
    window.key("o")
    window.wait_for(lambda state: state["tool"] == "eyedropper", "O to take the eyedropper")
    window.key("alt+bracketright")
    window.click(*window.pixel_of(RED_CAR_SIDE))
    window.wait_for(lambda state: state["cursor"] == 2, "the eyedropper to select")
    window.key("ctrl+z")
    window.wait_for(lambda state: state["selected_splats"] == flooded["selected_splats"], "undo")
    assert window.quit() == 0
