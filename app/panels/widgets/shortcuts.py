"""Shortcuts as keys: which of them are pressed in this frame."""

from __future__ import annotations

from functools import cache

from imgui_bundle import imgui

from instdrive_app.preferences.key_presets import KEY_NAMES

_MODIFIERS = {"Ctrl": imgui.Key.mod_ctrl, "Alt": imgui.Key.mod_alt, "Shift": imgui.Key.mod_shift}
_SYSTEM = imgui.Key.mod_super
"""Part of no shortcut; with it a key means something to the desktop."""
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


def is_shortcut_pressed(shortcut: str) -> bool:
    """Whether the shortcut's key went down in this frame, with its modifiers held and no others.

    A modifier that was let go in this frame counts as held: where frames last long, both fall into one.
    """
    *modifiers, key = shortcut.split("+")
    return imgui.is_key_pressed(_parse_key(key), False) and _read_held() == set(modifiers)


def read_pressed_shortcut() -> str | None:
    """Read the shortcut whose keys are pressed in this frame, e.g. ``Ctrl+D``; None where none is."""
    pressed = next((key for key in KEY_NAMES if imgui.is_key_pressed(_parse_key(key), False)), None)
    held = _read_held()
    return None if pressed is None else "+".join((*(name for name in _MODIFIERS if name in held), pressed))


@cache
def _parse_key(key: str) -> imgui.Key:
    name = _NAMED.get(key, key.lower())
    return getattr(imgui.Key, f"_{name}" if name.isdigit() else name)


def _read_held() -> set[str]:
    """Modifiers that are down, or were until this frame."""
    keys = _MODIFIERS | {"super": _SYSTEM}
    return {name for name, key in keys.items() if imgui.is_key_down(key) or imgui.is_key_released(key)}
