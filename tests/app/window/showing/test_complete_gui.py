"""*Complete by symmetry* in the real window: once it mirrors, then it says that nothing is left to do."""

import pytest
from half_seen_car import CAR, half_seen_car
from window_driver import editor_window

from instdrive_core.formats.registry import open_scene, save_scene

pytestmark = pytest.mark.gui


def complete(window):
    window.click_widget("menu Edit")
    window.click_widget("menu edit.complete")


def test_a_half_seen_car_is_completed_and_a_whole_one_is_told(tmp_path):
    save_scene(tmp_path / "half", half_seen_car())
    with editor_window(tmp_path / "half", tmp_path) as window:
        window.click_widget(f"instances.{CAR}")
        window.wait_for_selection(CAR)
        complete(window)
        window.wait_for_edit(f"Complete instance {CAR}")
        window.wait_for_message("the unseen side is now the mirror image of the other one")
        assert window.wait_until_calm()["selected"] == [CAR]
        complete(window)
        window.wait_for_message("Both sides of Car 3 were seen: there is nothing to complete")
        window.export(tmp_path / "out")
        assert (open_scene(tmp_path / "out").extra["synthetic"] == 3).sum() > 500
        window.key("ctrl+z")
        window.wait_for(lambda state: state["cursor"] == 1, "the completion to be undone")
        assert window.quit() == 0
