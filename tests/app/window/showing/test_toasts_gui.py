"""Messages that appear while a list is open lie below it, and take no click from it."""

import pytest
from chatty_editor import SPEAK
from procedural_street import procedural_street
from window_driver import editor_window

from instdrive_core.formats.registry import save_scene

pytestmark = pytest.mark.gui


@pytest.fixture
def window(tmp_path):
    """The window of an editor that speaks once it is told to."""
    save_scene(tmp_path / "street", procedural_street(0.2))
    with editor_window(tmp_path / "street", tmp_path, program="chatty_editor.py") as driver:
        yield driver


def speak_over(window, tmp_path, name):
    """Have so much told that it lies over a widget."""
    x, y = window.wait_for_widget(name)
    (tmp_path / SPEAK).touch()

    def lies_over(state):
        toasts = [rect for key, rect in state["widgets"].items() if key.startswith("toast.")]
        return any(left < x < right and top < y < bottom for left, top, right, bottom in toasts)

    window.wait_for(lies_over, f"a message over {name}")


def test_a_list_of_a_dialog_keeps_its_clicks(window, tmp_path):
    window.key("ctrl+e")
    window.click_widget("export.what")
    speak_over(window, tmp_path, "export.what.nurec")
    window.click_widget("export.what.nurec")
    window.wait_for_widget("export.nurec.tracks")
    window.key("Escape")
    window.wait_for(lambda state: "dialog.path" not in state["widgets"], "the dialog to close")
    assert window.quit() == 0
