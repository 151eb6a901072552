"""The clip's cameras in the real window: shown by key, named by the mouse, and looked through by a click."""

import pytest

pytestmark = pytest.mark.gui


def test_cameras_are_shown_named_and_looked_through(window):
    window.wait_for(lambda state: state["cameras"]["looked_through"] == 0, "the first camera")
    window.key("shift+Home")
    window.wait_for(lambda state: state["cameras"]["looked_through"] is None, "the view from above")
    window.key("alt+c")
    shown = window.wait_for(lambda state: len(state["cameras"]["shown"]) == 2, "both cameras of the moment")
    index = shown["cameras"]["shown"][1]
    window.key("alt+shift+c")
    window.wait_for(lambda state: len(state["cameras"]["shown"]) == 8, "the cameras of all moments")
    window.key("alt+shift+c")
    window.wait_for(lambda state: len(state["cameras"]["shown"]) == 2, "those of the moment again")
    x, y = window.wait_for_widget(f"gizmo.camera.{index}")
    window.move(x, y)
    window.wait_for(lambda state: state["cameras"]["hovered"] == index, "the camera under the mouse")
    window.wait_for_rect("gizmo.camera_label")
    window.click(x, y)
    state = window.wait_for(lambda state: state["cameras"]["looked_through"] == index, "the view of that camera")
    assert not state["selected"], "the click was for the camera"
    assert index not in state["cameras"]["shown"]
    window.key("alt+c")
    window.wait_for(lambda state: not state["cameras"]["shown"], "the cameras to be gone")
    assert window.quit() == 0
