"""Shortcuts as keys: which of them are pressed in this frame."""

from __future__ import annotations

from functools import cache

from imgui_bundle import imgui

from instdrive_app.preferences.key_presets import KEY_NAMES

_MODIFIERS = {"Ctrl": imgui.Key.mod_ctrl, "Alt": imgui.Key.mod_alt, "Shift": imgui.Key.mod_shift}
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
        self._down, self._held = 0, 0
        """Modifiers that are down, and that count, as in ImGui's key chords."""
        self._is_used = False
        """Whether a key or a button was pressed while the modifiers were held."""
        self._pressed: tuple[str, ...] = ()

    def update(self) -> None:
        """Look at the keyboard; to be called once in each frame, whether anybody asks or not."""
        io = imgui.get_io()
        let_go = 0 if self._is_used else self._down & ~io.key_mods
        self._down, self._held = io.key_mods, io.key_mods | let_go
        self._pressed = tuple(key for key in KEY_NAMES if imgui.is_key_pressed(_parse_key(key), False))
        clicked = any(imgui.is_mouse_clicked(button) for button in range(3)) or io.mouse_wheel != 0
        self._is_used = self._down != 0 and (self._is_used or clicked or bool(self._pressed))

    def is_pressed(self, shortcut: str) -> bool:
        """Whether the shortcut's key went down in this frame, with its modifiers held and no others."""
        chord = parse_shortcut(shortcut)
        return any(int(_parse_key(key)) | self._held == chord for key in self._pressed)

    def read(self) -> str | None:
        """Read the shortcut whose keys are pressed in this frame, e.g. ``Ctrl+D``; None where none is."""
        held = (name for name, key in _MODIFIERS.items() if self._held & key)
        return "+".join((*held, self._pressed[0])) if self._pressed else None


@cache
def _parse_key(key: str) -> imgui.Key:
    name = _NAMED.get(key, key.lower())
    return getattr(imgui.Key, f"_{name}" if name.isdigit() else name)
