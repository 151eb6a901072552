"""First steps of a new user in the real window: double click, the wheel with Alt, a long drag, and the way back."""

import numpy as np
import pytest
from procedural_street import FIRST_CAR, ROAD

pytestmark = pytest.mark.gui
BLUE_CAR, MIDDLE = FIRST_CAR + 1, (3.0, 9.4, 0.7)


def test_a_car_is_framed_gone_behind_and_orbited_without_diving_under_the_road(window):
    start = np.array(window.state["camera"]["world_from_camera"])
    place = window.pixel_of(MIDDLE)
    window.click(*place)
    (chosen,) = window.wait_for(lambda state: len(state["selected"]) == 1, "one instance")["selected"]
    assert chosen != ROAD
    window.wheel(*place, -1, "alt")
    state = window.wait_for(lambda state: "stack" in state["widgets"], "the list of what is behind")
    assert state["selected"] != [chosen]
    np.testing.assert_array_equal(state["camera"]["world_from_camera"], start, "the wheel does not move the camera")
    window.click_widget(f"stack.{chosen}")
    window.wait_for_selection(chosen)
    left, _, right, bottom = window.state["widgets"]["picture"]
    window.click((left + right) / 2, bottom - 30)  # elsewhere: what follows is a double click of its own
    window.double_click(*window.pixel_of(MIDDLE))
    state = window.wait_for(lambda state: not np.allclose(state["camera"]["world_from_camera"], start), "to frame it")
    assert state["selected"] == [chosen]
    left, top, right, bottom = window.wait_until_calm()["widgets"]["picture"]
    middle = ((left + right) / 2, (top + bottom) / 2)
    window.drag((middle[0], bottom - 60), (middle[0], top + 30), steps=12)
    height = window.wait_until_calm()["camera"]["world_from_camera"][2][3]
    assert 0 < height < 1.0, "the drag ends just above the road"
    window.key("ctrl+Home")
    window.wait_for(lambda state: np.allclose(state["camera"]["world_from_camera"], start), "the start view")
    window.key("ctrl+p")
    window.wait_for_widget("palette.search")
    window.type("fill the hole of")
    window.wait_for_widget("palette.deletion.fill")
    window.tap("Return")
    window.wait_for_widget("palette.reason")
    window.key("Escape")
    assert window.quit() == 0
