"""A car that is put into another one, in the real window: the user is told, and it stays."""

import pytest
from procedural_street import FIRST_CAR
from window_driver import editor_window

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.queries.placement import compute_center
from instdrive_core.formats.registry import open_scene

pytestmark = pytest.mark.gui


def test_a_car_put_into_another_is_told_and_stays(street_folder, tmp_path):
    other = Document(open_scene(street_folder))
    there = compute_center(other, (FIRST_CAR + 1,), 0.0)
    with editor_window(street_folder, tmp_path) as window:
        window.click_widget(f"instances.{FIRST_CAR}")
        window.wait_for_selection(FIRST_CAR)
        for axis, value in (("x", there[0] + 0.3), ("y", there[1] + 0.8)):
            window.click_widget(f"inspector.{axis}", "ctrl")
            window.key("ctrl+a")
            window.type(f"{value:.2f}")
            window.tap("Return")
            window.wait_until_calm()
        window.wait_for_message("parked car 1 reaches ")
        state = window.wait_until_calm()
        assert any("into parked car 2" in text for text in state["messages"])
        assert state["cursor"] > 1
        assert window.quit() == 0
