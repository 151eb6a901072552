"""Finding and checking the display that windows open on."""

from __future__ import annotations

import os
import sys

from instdrive_core.errors import InstDriveError


class DisplayError(InstDriveError):
    """No window can be opened here."""


def find_display_name() -> str:
    """Find the display's name in the environment; empty where there is none."""
    if not sys.platform.startswith("linux"):
        return "the desktop"
    return os.environ.get("WAYLAND_DISPLAY") or os.environ.get("DISPLAY") or ""


def has_display() -> bool:
    """Whether the environment names a display to open windows on."""
    return bool(find_display_name())


def check_display() -> None:
    """Raise DisplayError, with the window system's reason, where the display cannot be opened.

    Must not be called while a window is open.
    """
    import glfw

    reasons: list[str] = []
    glfw.set_error_callback(lambda _, reason: reasons.append(str(reason, "utf-8", "replace")))  # type: ignore[arg-type]
    if not glfw.init():
        raise DisplayError(f"{find_display_name()} does not open ({'; '.join(reasons) or 'no reason given'})")
    glfw.terminate()
