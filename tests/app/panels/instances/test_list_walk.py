"""Going through the list of instances by keys."""

import pytest
from procedural_street import FIRST_CAR

from instdrive_app.panels.instances.list_walk import Walk

IDS = (5, 3, 9, 7)


def anywhere(_):
    return True


def walk_steps(walk, *steps, extends=False, may_stop=anywhere):
    for step in steps:
        walk = walk.advance(step, extends, IDS, may_stop)
    return walk


def test_steps_go_through_the_list_and_end_at_its_ends():
    assert walk_steps(Walk(), "down") == Walk(5, 5)
    assert walk_steps(Walk(), "up") == Walk(7, 7)
    assert walk_steps(Walk(3, 3), "down", "down", "down") == Walk(7, 7)
    assert walk_steps(Walk(3, 3), "up", "up") == Walk(5, 5)
    assert walk_steps(Walk(3, 3), "last") == Walk(7, 7)
    assert walk_steps(Walk(9, 9), "first") == Walk(5, 5)
    assert walk_steps(Walk(99, 99), "down") == Walk(5, 5), "what is no longer listed is nowhere"
    assert Walk(4, 4).advance("down", False, (), anywhere) == Walk(4, 4)


def test_a_range_has_one_end_that_stays():
    walk = walk_steps(Walk(3, 3), "down", "down", extends=True)
    assert (walk, walk.list_range(IDS)) == (Walk(3, 7), (3, 9, 7))
    walk = walk_steps(walk, "first", extends=True)
    assert (walk, walk.list_range(IDS)) == (Walk(3, 5), (5, 3))


def test_what_cannot_be_selected_is_stepped_over():
    assert walk_steps(Walk(5, 5), "down", may_stop=lambda i: i not in (3, 9)) == Walk(7, 7)
    assert walk_steps(Walk(9, 9), "down", may_stop=lambda i: i != 7) == Walk(9, 9)


@pytest.mark.gui
def test_keys_walk_through_the_list_in_the_window(window):
    window.click_widget(f"instances.{FIRST_CAR}")
    window.wait_for_selection(FIRST_CAR)
    camera = window.state["camera"]
    window.tap("Down")
    window.wait_for_selection(FIRST_CAR + 1)
    window.tap("shift+Down")
    window.wait_for_selection(FIRST_CAR + 1, FIRST_CAR + 2)
    window.tap("shift+Up")
    window.wait_for_selection(FIRST_CAR + 1)
    window.tap("End")
    window.wait_for_selection(33)
    assert "instances.33" in window.wait_until_calm()["widgets"], "the list scrolls along"
    window.tap("Up")
    window.wait_for_selection(32)
    window.tap("Home")
    window.wait_for_selection(1)
    assert "instances.1" in window.wait_until_calm()["widgets"]
    assert window.state["camera"] == camera, "Home is the list's while it has the keyboard"
    window.tap("Return")
    window.wait_for_widget("instances.name")
    window.type("high street")
    window.tap("Return")
    window.wait_for_edit("Rename instance 1")
    window.click_widget("instances.search")
    window.type("car")
    window.tap("Down")
    window.wait_for_selection(FIRST_CAR)
    left, top, _, _ = window.wait_for_rect("picture")
    window.click(left + 300, top + 60)
    window.wait_for_selection()
    assert window.state["cameras"]["looked_through"] is not None, "the scene opens as its first photo"
    window.tap("Home")
    window.wait_for(
        lambda state: state["cameras"]["looked_through"] is None, "Home to frame everything after a click into the view"
    )
    assert window.quit() == 0
