"""What the window offers while no scene is open, and messages that disappear at a click."""

import pytest
from window_driver import editor_window

from instdrive_app.files.sample import find_sample_scene


@pytest.fixture
def window(tmp_path):
    """The editor, after it was asked to open what is no scene."""
    broken = tmp_path / "broken.ply"
    broken.write_bytes(b"no scene at all")
    with editor_window(broken, tmp_path, opens=False) as driver:
        yield driver


@pytest.mark.gui
def test_a_window_without_a_scene_offers_to_open_one(window):
    window.wait_for_message("broken.ply")
    window.click_widget("toast.0")
    window.wait_for(lambda state: "toast.0" not in state["widgets"], "the error to go at a click")
    window.click_widget("empty.open")
    window.wait_for_widget("dialog.path")
    window.key("Escape")
    window.wait_for(lambda state: "dialog.path" not in state["widgets"], "the dialog to close")
    window.click_widget("empty.sample")
    state = window.wait_for(lambda state: state["open"], "the sample scene")
    assert "empty.sample" not in state["widgets"]
    assert any(find_sample_scene().name in text for text in state["messages"])
    assert window.quit() == 0


@pytest.mark.gui
def test_escape_closes_a_menu_and_nothing_else(window):
    window.click_widget("empty.sample")
    window.wait_for(lambda state: state["open"], "the sample scene")
    window.key("ctrl+a")
    window.wait_for(lambda state: state["selected"], "everything selected")
    window.click_widget("menu Help")
    window.wait_for_widget("menu help.log")
    window.key("Escape")
    window.wait_for(lambda state: "menu help.log" not in state["widgets"], "the menu to close")
    assert window.wait_until_calm()["selected"]
    window.key("Escape")
    window.wait_for(lambda state: not state["selected"], "nothing selected")
