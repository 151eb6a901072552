"""Numbers typed into fields and sliders of the real window: what is no number changes nothing and breaks nothing."""

import pytest
from procedural_street import FIRST_CAR

pytestmark = pytest.mark.gui

RED_CAR_SIDE = (-2.1, 4.6, 0.8)


def type_number(window, widget, text):
    window.click_widget(widget, "ctrl")
    window.key("ctrl+a")
    window.type(text)
    window.tap("Return")
    return window.wait_until_calm()


def test_numbers_are_typed_and_nonsense_is_passed_over(window):
    window.click(*window.pixel_of(RED_CAR_SIDE))
    window.wait_for_selection(FIRST_CAR)
    steps = window.wait_until_calm()["cursor"]
    for widget, text in (("inspector.scale", "nan"), ("inspector.x", "abc")):
        assert type_number(window, widget, text)["cursor"] == steps, f"{text!r} in {widget}"
    type_number(window, "inspector.yaw", "45")
    state = window.wait_for_edit("Rotate instance")
    assert state["cursor"] == steps + 1
    window.key("2")
    window.wait_for(lambda state: "viewport.opacity" in state["widgets"], "the ID view")
    x, y = window.pixel_of(RED_CAR_SIDE)
    type_number(window, "viewport.opacity", "nan")
    window.move(x, y)
    window.wait_for(lambda state: state["hovered"] == FIRST_CAR, "the car to be hovered")
    assert [text for text in state["messages"] if "not a" in text] == []
    assert window.quit() == 0
