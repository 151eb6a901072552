"""A shortcut is what was pressed, however long frames last and whichever key is let go first."""

import pytest
from imgui_bundle import imgui

from instdrive_app.panels.widgets.shortcuts import PressedKeys

CTRL, SHIFT = (imgui.Key.left_ctrl, imgui.Key.mod_ctrl), (imgui.Key.left_shift, imgui.Key.mod_shift)
Z, DELETE = (imgui.Key.z,), (imgui.Key.delete,)


@pytest.fixture
def frame():
    """A function that draws a frame in which keys go down or up, in that order, and says what is pressed then."""
    context = imgui.create_context()
    io = imgui.get_io()
    io.display_size = imgui.ImVec2(100, 100)
    io.backend_flags |= imgui.BackendFlags_.renderer_has_textures
    io.set_ini_filename("")
    keys = PressedKeys()

    def draw(*events):
        for given, is_down in events:
            for key in given:
                io.add_key_event(key, is_down)
        imgui.new_frame()
        keys.update()
        shortcuts = ("Z", "Ctrl+Z", "Shift+Z", "Ctrl+Shift+Z", "Delete")
        pressed = [shortcut for shortcut in shortcuts if keys.is_pressed(shortcut)]
        assert pressed == [shortcut for shortcut in (keys.read(),) if shortcut]
        imgui.end_frame()
        return pressed

    yield draw
    imgui.destroy_context(context)


def test_a_modifier_let_go_in_the_frame_of_the_key_is_held(frame):
    assert frame() == []
    assert frame((CTRL, True)) == []
    assert frame((Z, True), (CTRL, False)) == ["Ctrl+Z"]
    assert frame((Z, False)) == []
    assert frame((Z, True)) == ["Z"], "it does not count for the next frames"


def test_all_in_one_frame(frame):
    frame()
    assert frame((CTRL, True), (Z, True), (CTRL, False), (Z, False)) == ["Ctrl+Z"]
    assert frame() == frame() == []
    assert frame((Z, True), (Z, False)) == ["Z"]


def test_held_modifiers_are_all_of_the_shortcut_and_a_held_key_is_pressed_once(frame):
    frame()
    assert frame((SHIFT, True), (CTRL, True)) == []
    assert frame((Z, True)) == ["Ctrl+Shift+Z"]
    assert frame() == frame() == []
    assert frame((Z, False), (SHIFT, False)) == []
    assert frame((Z, True)) == ["Ctrl+Z"]


def test_a_modifier_that_served_its_key_is_let_go(frame):
    frame()
    assert frame((CTRL, True), (Z, True)) == ["Ctrl+Z"]
    assert frame((Z, False), (CTRL, False), (DELETE, True)) == ["Delete"]
