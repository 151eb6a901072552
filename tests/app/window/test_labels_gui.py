"""Instances panel, inspector, label repair and history in the real window, by true mouse and key events."""

import pytest
from procedural_street import FIRST_CAR

pytestmark = pytest.mark.gui

CARS = [FIRST_CAR, FIRST_CAR + 1]
NEW = 34
"""The first ID that the street does not use."""


def test_merge_split_reassign_and_class(window):
    window.click_widget(f"instances.{CARS[0]}")
    window.wait_for_selection(CARS[0])
    window.click_widget(f"instances.{CARS[1]}", "shift")
    window.wait_for_selection(*CARS)
    window.key("ctrl+m")
    window.wait_for_edit(f"Merge instance {CARS[1]} into instance {CARS[0]}")
    assert f"instances.{CARS[1]}" not in window.wait_until_calm()["widgets"]
    window.key("ctrl+j")
    window.click_widget("dialog.accept")
    window.wait_for_edit(f"Split instance {CARS[0]}")
    window.click_widget(f"instances.{NEW}")
    window.wait_for_selection(NEW)
    window.key("ctrl+r")
    window.wait_for_widget("reassign.search")
    window.type("car 3")
    window.click_widget("dialog.accept")
    window.wait_for_edit(f"Reassign selection to instance {FIRST_CAR + 2}")
    window.click_widget("inspector.classes")
    window.click_widget("inspector.class.Tree")
    window.wait_for_edit(f"Set class of instance {FIRST_CAR + 2} to Tree")
    window.key("ctrl+t")
    window.wait_for_widget("class.name")
    window.type("Taxi")
    window.tap("Return")
    window.wait_for_edit(f"Set class of instance {FIRST_CAR + 2} to Taxi")
    for _ in range(5):
        window.tap("ctrl+z")  # a key held over slow frames repeats
    window.wait_for(lambda state: state["cursor"] == len(state["history"]) - 5, "five steps back")
    assert window.quit() == 0


def test_lock_solo_search_classes_and_names(window):
    red, blue = CARS
    window.click_widget(f"instances.{red}.lock")
    window.wait_for_edit(f"Lock instance {red}")
    window.click_widget(f"instances.{red}")
    window.wait_for(lambda state: any("is locked" in text for text in state["messages"]), "the lock to be told")
    assert window.state["selected"] == []
    window.click_widget(f"instances.{blue}.solo")
    window.wait_for(lambda state: state["visible"] == [blue], "one alone")
    window.click_widget("instances.leave_solo")
    window.wait_for(lambda state: len(state["visible"]) > 10, "all again")
    window.click_widget("instances.class.Tree")
    window.click_widget("instances.select_shown")
    window.wait_for_selection(30, 31, 32, 33)
    window.click_widget("instances.class.Tree")
    window.click_widget(f"instances.{blue}")
    window.wait_for_selection(blue)
    window.key("F2")
    window.wait_for_widget("instances.name")
    window.type("taxi")
    window.tap("Return")
    window.wait_for_edit(f"Rename instance {blue} to taxi")
    window.click_widget("instances.search")
    window.type("taxi")
    window.wait_for(lambda state: f"instances.{red}" not in state["widgets"], "the search")
    window.click_widget(f"instances.{blue}", button=3)
    window.click_widget("menu.classes")
    window.click_widget("menu.class.Tree")
    window.wait_for_edit(f"Set class of instance {blue} to Tree")
    assert window.quit() == 0


def test_sliders_reset_and_history(window):
    red = CARS[0]
    window.click(*window.pixel_of((-2.1, 4.6, 0.8)))
    window.wait_for_selection(red)
    window.click_widget("inspector.placement")  # folds it: the sliders come into view
    x, y = window.wait_for_widget("inspector.adjust.hue")
    window.drag((x, y), (x + 50, y))
    state = window.wait_for(lambda state: state["history"][-1].startswith("Set hue"), "the slider")
    steps = state["cursor"]
    assert [title for title in state["history"] if "hue" in title] == state["history"][-1:], "a drag is one step"
    window.click_widget("inspector.mode.hue")
    window.click_widget("inspector.color.green")
    window.wait_for(lambda state: state["history"][-1].startswith("Shift hue"), "the hue mode")
    window.key("shift+c")
    window.wait_for_edit(f"Reset colours of instance {red}")
    left, top, *_ = window.state["widgets"]["inspector.name"]
    window.click(left + 90, top - 22)  # the tab beside the inspector's
    window.click_widget(f"history.{steps}")
    window.wait_for(lambda state: state["cursor"] == steps, "the history to go back")
    assert window.state["history"][-1] == f"Reset colours of instance {red}", "what is undone stays to be redone"
    assert window.quit() == 0


def test_clicks_on_rows_and_their_switches_count_also_where_a_frame_lasts_long(window):
    red, blue = CARS
    for name in (red, blue, f"{red}.lock", f"{blue}.eye", red):
        place = window.wait_for_widget(f"instances.{name}")
        with window.stalled():
            window.hasty_click(*place)
        if name == f"{red}.lock":
            window.wait_for_edit(f"Lock instance {red}")
            window.key("ctrl+z")
            window.wait_for_selection(blue)
        elif name == f"{blue}.eye":
            window.wait_for(lambda state: blue not in state["visible"], "the eye to hide, and nothing else to happen")
            assert window.state["selected"] in ([], [blue])
        else:
            window.wait_for_selection(name)
    assert window.quit() == 0
