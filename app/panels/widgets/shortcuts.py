"""Shortcuts as keys: which of them are pressed in this frame."""

from __future__ import annotations

from functools import cache

from imgui_bundle import imgui

from instdrive_app.preferences.key_presets import KEY_NAMES

_MODIFIERS = {"Ctrl": imgui.Key.mod_ctrl, "Alt": imgui.Key.mod_alt, "Shift": imgui.Key.mod_shift}
_HOLDABLE = _MODIFIERS | {"super": imgui.Key.mod_super}
"""With the last one a key means something to the desktop: it is part of no shortcut."""
_NAMED = {
    "LeftArrow": "left_arrow",
    "RightArrow": "right_arrow",
    "=": "equal",
    "-": "minus",
    "[": "left_bracket",
    "]": "right_bracket",
    ",": "comma",
    ".": "period",
    "/": "slash",
    ";": "semicolon",
    "'": "apostrophe",
    "`": "grave_accent",
    "\\": "backslash",
    "PageDown": "page_down",
    "PageUp": "page_up",
}


@cache
def parse_shortcut(shortcut: str) -> int:
    """Convert a shortcut such as ``Ctrl+Shift+Z`` to ImGui's key chord.

    Raises KeyError or AttributeError for a key that does not exist.
    """
    *modifiers, key = shortcut.split("+")
    chord = int(_parse_key(key))
    for modifier in modifiers:
        chord |= int(_MODIFIERS[modifier])
    return chord


class PressedKeys:
    """Which shortcut was pressed in a frame.

    Where frames last long, a key goes down and its modifier up in one. Then the modifier still counts, unless
    another key or a mouse button was pressed while it was held: that one was meant by it.
    """

    def __init__(self) -> None:
        self._down: set[str] = set()
        self._is_used = False
        """Whether a key or a button was pressed while the modifiers were held."""
        self._held: set[str] = set()

    def update(self) -> None:
        """Look at the keyboard; to be called once in each frame, whether anybody asks or not."""
        down = {name for name, key in _HOLDABLE.items() if imgui.is_key_down(key)}
        let_go = set() if self._is_used else self._down - down
        self._held = down | let_go
        pressed = any(imgui.is_key_pressed(_parse_key(key), False) for key in KEY_NAMES)
        pressed |= any(imgui.is_mouse_clicked(button) for button in range(3)) or imgui.get_io().mouse_wheel != 0
        self._is_used = bool(down) and (self._is_used or pressed)
        self._down = down

    def is_pressed(self, shortcut: str) -> bool:
        """Whether the shortcut's key went down in this frame, with its modifiers held and no others."""
        *modifiers, key = shortcut.split("+")
        return imgui.is_key_pressed(_parse_key(key), False) and self._held == set(modifiers)

    def read(self) -> str | None:
        """Read the shortcut whose keys are pressed in this frame, e.g. ``Ctrl+D``; None where none is."""
        pressed = next((key for key in KEY_NAMES if imgui.is_key_pressed(_parse_key(key), False)), None)
        return None if pressed is None else "+".join((*(name for name in _MODIFIERS if name in self._held), pressed))


@cache
def _parse_key(key: str) -> imgui.Key:
    name = _NAMED.get(key, key.lower())
    return getattr(imgui.Key, f"_{name}" if name.isdigit() else name)
