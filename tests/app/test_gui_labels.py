"""Instances panel, inspector, label repair and history in the real window, by true mouse and key events."""

import shutil

import pytest
from procedural_street import FIRST_CAR, procedural_street
from window_driver import WindowDriver

from instdrive_app.virtual_display import virtual_display
from instdrive_core.formats.registry import save_scene

pytestmark = pytest.mark.gui

CARS = [FIRST_CAR, FIRST_CAR + 1]
NEW = 34
"""The first ID that the street does not use."""


@pytest.fixture(scope="module")
def street_folder(tmp_path_factory):
    """The street as a scene folder."""
    path = tmp_path_factory.mktemp("street") / "street"
    save_scene(path, procedural_street())
    return path


@pytest.fixture
def window(street_folder, tmp_path):
    """An editor window that has opened the street."""
    for tool in ("Xvfb", "xdotool"):
        if shutil.which(tool) is None:
            pytest.skip(f"{tool} is not installed")
    with virtual_display((1280, 720)):
        driver = WindowDriver(street_folder, tmp_path)
        try:
            driver.wait_for(lambda state: state["open"] and state["settled"], "the scene to be open")
            driver.wait_until_calm()
            yield driver
        finally:
            driver.close()


def selects(window, ids, what):
    return window.wait_for(lambda state: state["selected"] == ids, what)


def done(window, title):
    def is_last(state):
        return state["cursor"] == len(state["history"]) > 0 and state["history"][-1] == title

    return window.wait_for(is_last, title)


def test_merge_split_reassign_and_class(window):
    window.click_widget(f"instances.{CARS[0]}")
    selects(window, CARS[:1], "a row to select")
    window.click_widget(f"instances.{CARS[1]}", "shift")
    selects(window, CARS, "Shift to select a range")
    window.key("ctrl+m")
    done(window, f"Merge instance {CARS[1]} into instance {CARS[0]}")
    assert f"instances.{CARS[1]}" not in window.wait_until_calm()["widgets"]
    window.key("ctrl+j")
    window.click_widget("dialog.accept")
    done(window, f"Split instance {CARS[0]}")
    window.click_widget(f"instances.{NEW}")
    selects(window, [NEW], "the piece in the list")
    window.key("ctrl+r")
    window.wait_for_widget("reassign.search")
    window.type("car 3")
    window.click_widget("dialog.accept")
    done(window, f"Reassign selection to instance {FIRST_CAR + 2}")
    window.click_widget("inspector.classes")
    window.click_widget("inspector.class.Tree")
    done(window, f"Set class of instance {FIRST_CAR + 2} to Tree")
    window.key("ctrl+t")
    window.wait_for_widget("class.name")
    window.type("Taxi")
    window.key("Return")
    done(window, f"Set class of instance {FIRST_CAR + 2} to Taxi")
    for _ in range(5):
        window.key("ctrl+z")
    window.wait_for(lambda state: state["cursor"] == len(state["history"]) - 5, "five steps back")
    assert window.quit() == 0


def test_lock_solo_search_classes_and_names(window):
    red, blue = CARS
    window.click_widget(f"instances.{red}.lock")
    done(window, f"Lock instance {red}")
    window.click_widget(f"instances.{red}")
    window.wait_for(lambda state: any("is locked" in text for text in state["messages"]), "the lock to be told")
    assert window.state["selected"] == []
    window.click_widget(f"instances.{blue}.solo")
    window.wait_for(lambda state: state["visible"] == [blue], "one alone")
    window.click_widget("instances.leave_solo")
    window.wait_for(lambda state: len(state["visible"]) > 10, "all again")
    window.click_widget("instances.class.Tree")
    window.click_widget("instances.select_shown")
    selects(window, [30, 31, 32, 33], "all trees")
    window.click_widget("instances.class.Tree")
    window.click_widget(f"instances.{blue}")
    selects(window, [blue], "the blue car")
    window.key("F2")
    window.wait_for_widget("instances.name")
    window.type("taxi")
    window.key("Return")
    done(window, f"Rename instance {blue} to taxi")
    window.click_widget("instances.search")
    window.type("taxi")
    window.wait_for(lambda state: f"instances.{red}" not in state["widgets"], "the search")
    window.click_widget(f"instances.{blue}", button=3)
    window.click_widget("menu.classes")
    window.click_widget("menu.class.Tree")
    done(window, f"Set class of instance {blue} to Tree")
    assert window.quit() == 0


def test_sliders_reset_and_history(window):
    red = CARS[0]
    window.click(*window.pixel_of((-2.1, 4.6, 0.8)))
    selects(window, [red], "the red car")
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
    done(window, f"Reset colours of instance {red}")
    left, top, *_ = window.state["widgets"]["inspector.name"]
    window.click(left + 90, top - 22)  # the tab beside the inspector's
    window.click_widget(f"history.{steps}")
    window.wait_for(lambda state: state["cursor"] == steps, "the history to go back")
    assert window.state["history"][-1] == f"Reset colours of instance {red}", "what is undone stays to be redone"
    assert window.quit() == 0
