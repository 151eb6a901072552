"""Shadows of what is moved, in the real window: with the move, undone with it, switched off, removed and laid."""

import pytest
from parked_street import CAR, parked_street
from window_driver import editor_window

from instdrive_core.formats.registry import save_scene

pytestmark = pytest.mark.gui


@pytest.fixture
def window(tmp_path):
    """The window on a street with one parked car, which is selected."""
    save_scene(tmp_path / "parked", parked_street().scene)
    with editor_window(tmp_path / "parked", tmp_path) as driver:
        driver.click_widget(f"instances.{CAR}")
        driver.wait_for_selection(CAR)
        yield driver


def choose(window, name):
    window.click_widget("menu Move")
    window.click_widget(f"menu {name}")


def wait_for_shadow(window, *ids):
    return window.wait_for(lambda state: state["shadowed"] == list(ids), f"shadows below {ids}")


def place(window, axis, text):
    window.click_widget(f"inspector.{axis}", "ctrl")
    window.key("ctrl+a")
    window.type(text)
    window.tap("Return")


def test_a_moved_car_gets_a_shadow_which_undo_takes_away_with_the_move(window):
    place(window, "x", "-1.5")
    state = wait_for_shadow(window, CAR)
    assert state["history"][1:] == [f"Move instance {CAR}"]
    told = window.wait_for(lambda state: "deletion.fill" in state["widgets"], "the hole it has left")
    assert "where it stood" in told["messages"][-1]
    window.key("ctrl+z")
    state = wait_for_shadow(window)
    assert state["cursor"] == 1
    assert "deletion.fill" not in window.wait_until_calm()["widgets"], "the hole went with the move"
    window.key("ctrl+y")
    assert wait_for_shadow(window, CAR)["cursor"] == 2
    window.wait_for(lambda state: "deletion.fill" in state["widgets"], "the hole again")
    assert window.quit() == 0


def test_shadows_are_switched_off_removed_and_laid_by_hand(window):
    choose(window, "move.lay_shadows")
    place(window, "x", "-1.5")
    window.wait_for_edit(f"Move instance {CAR}")
    assert window.wait_until_calm(1.0)["shadowed"] == []
    choose(window, "move.add_shadow")
    wait_for_shadow(window, CAR)
    choose(window, "move.remove_shadow")
    state = wait_for_shadow(window)
    assert state["history"][2:] == [f"Lay shadow of instance {CAR}", f"Remove the shadow of instance {CAR}"]
    assert window.quit() == 0
