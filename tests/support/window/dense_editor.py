"""The editor on a display with two pixels of the screen, along each axis, for one of the window, as Macs have them.

X11 knows no such displays. ImGui is told of one as each frame begins, and of the mouse in the window's pixels: what
follows is what happens on such displays. ``python dense_editor.py ARGUMENTS`` takes those of `instdrive`.
"""

import ctypes
import sys

import glfw
from imgui_bundle import ImVec2, _imgui_bundle, glfw_utils, imgui

from instdrive_app.main import main
from instdrive_app.shell.window import EditorWindow

DENSITY = 2
NEW_FRAME = 0
"""Hooks of this kind run first of all in a frame, after GLFW has said how large the window is."""
HookFunction = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)


class Hook(ctypes.Structure):
    """ImGui's `ImGuiContextHook`, whose function Python cannot set otherwise."""

    _fields_ = (
        ("hook_id", ctypes.c_uint),
        ("kind", ctypes.c_int),
        ("owner", ctypes.c_uint),
        ("function", HookFunction),
        ("user_data", ctypes.c_void_p),
    )


@HookFunction
def _halve_window(_context, _hook):
    io = imgui.get_io()
    io.display_size = ImVec2(io.display_size.x / DENSITY, io.display_size.y / DENSITY)
    io.display_framebuffer_scale = ImVec2(DENSITY, DENSITY)


def _prepare_editor(window):
    library = ctypes.CDLL(_imgui_bundle.__file__)
    find_context = library._ZN5ImGui17GetCurrentContextEv
    find_context.restype = ctypes.c_void_p
    add_hook = library._ZN5ImGui14AddContextHookEP12ImGuiContextPK16ImGuiContextHook
    add_hook(ctypes.c_void_p(find_context()), ctypes.byref(Hook(kind=NEW_FRAME, function=_halve_window)))
    _create_context(window)


def _prepare_ui(window):
    _create_ui(window)
    glfw.set_cursor_pos_callback(
        glfw_utils.glfw_window_hello_imgui(),
        lambda _, x, y: imgui.get_io().add_mouse_pos_event(x / DENSITY, y / DENSITY),
    )


_create_context, _create_ui = EditorWindow._create_context, EditorWindow._create_ui
EditorWindow._create_context, EditorWindow._create_ui = _prepare_editor, _prepare_ui

if __name__ == "__main__":
    sys.exit(main())
