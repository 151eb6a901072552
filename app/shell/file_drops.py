"""Receiving files dropped onto the window."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable
from pathlib import Path

_Callback = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int, ctypes.POINTER(ctypes.c_char_p))


def accept_drops(window: object, take: Callable[[tuple[Path, ...]], None]) -> object:
    """Pass the paths of every drop onto the window (GLFW's pointer) to `take`, as long as the result is kept.

    Bytes outside the file system's encoding stay in a path as surrogates. `glfw.set_drop_callback` would not do:
    where a name is not UTF-8, it raises in whichever GLFW function is called next, on any thread.
    """
    from glfw.library import glfw as loaded  # not before imgui_bundle, which tells it to use the same library

    def receive(_: int, count: int, names: ctypes._Pointer[ctypes.c_char_p]) -> None:  # pyright: ignore[reportPrivateUsage]
        take(tuple(Path(os.fsdecode(names[number] or b"")) for number in range(count)))

    assert loaded is not None, "GLFW has opened a window"
    callback = _Callback(receive)
    library = ctypes.CDLL(loaded._name)  # the same library; prototypes are set on this object only
    library.glfwSetDropCallback.argtypes = (ctypes.c_void_p, _Callback)
    library.glfwSetDropCallback.restype = ctypes.c_void_p
    library.glfwSetDropCallback(window, callback)
    return callback
