"""Keys and mouse gestures as in other programs: presets, and what a user's own keys make of them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from instdrive_core.errors import DataError
from instdrive_core.files.atomic import write_bytes
from instdrive_core.wording import phrase

Keys = Mapping[str, tuple[str, ...]]
"""Shortcuts by IDs of actions."""
Motion = Literal["orbit", "look", "pan", "dolly"]
LEFT, RIGHT, MIDDLE = 0, 1, 2
KEY_NAMES = (
    *"ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789=-[],./;'`\\",
    *(f"F{number}" for number in range(1, 13)),
    *("LeftArrow", "RightArrow", "PageUp", "PageDown", "Home", "End", "Insert"),
    *("Delete", "Backspace", "Enter", "Space", "Tab", "Escape"),
)
"""Keys that a shortcut can have."""


@dataclass(frozen=True)
class CameraDrag:
    """A mouse gesture on the picture that moves the camera."""

    button: int
    """`LEFT`, `RIGHT` or `MIDDLE`."""
    motion: Motion
    modifier: Literal["", "Shift", "Ctrl", "Alt"] = ""


@dataclass(frozen=True)
class KeyPreset:
    """The keys and gestures of one program."""

    title: str
    drags: tuple[CameraDrag, ...]
    """A drag without a modifier also answers where no other fits the held one."""
    flies_always: bool
    """Whether W A S D and Q E fly at any time; otherwise while the right button is held, and mean commands else."""
    keys: Keys
    """Shortcuts that differ from the actions' own."""

    def find_motion(self, button: int, shift: bool, ctrl: bool, alt: bool) -> Motion | None:
        """Find what a drag with a button and held keys does to the camera; None = nothing."""
        held = "Shift" if shift else "Ctrl" if ctrl else "Alt" if alt else ""
        fitting: dict[str, Motion] = {drag.modifier: drag.motion for drag in self.drags if drag.button == button}
        return fitting[held] if held in fitting else fitting.get("")


PRESETS = {
    "instdrive": KeyPreset(
        "InstDrive",
        (
            CameraDrag(LEFT, "orbit"),
            CameraDrag(LEFT, "pan", "Shift"),
            CameraDrag(RIGHT, "look"),
            CameraDrag(MIDDLE, "pan"),
        ),
        flies_always=True,
        keys={},
    ),
    "supersplat": KeyPreset(
        "SuperSplat",
        (CameraDrag(LEFT, "orbit"), CameraDrag(RIGHT, "pan"), CameraDrag(MIDDLE, "dolly")),
        flies_always=True,
        keys={
            "tool.move": ("1",),
            "tool.rotate": ("2",),
            "tool.scale": ("3",),
            "tool.rectangle": ("R",),
            "tool.polygon": ("P",),
            "tool.brush": ("B",),
            "edit.show_all": ("U",),
            "select.none": ("Escape", "Ctrl+Shift+A"),
            "view.photo": ("N",),
            "tool.flood": ("Shift+U",),
            "view.color": ("Ctrl+1",),
            "view.instance": ("Ctrl+2",),
            "view.codeword": ("Ctrl+3",),
        },
    ),
    "blender": KeyPreset(
        "Blender",
        (
            CameraDrag(LEFT, "orbit"),
            CameraDrag(RIGHT, "look"),
            CameraDrag(MIDDLE, "orbit"),
            CameraDrag(MIDDLE, "pan", "Shift"),
            CameraDrag(MIDDLE, "dolly", "Ctrl"),
        ),
        flies_always=False,
        keys={
            "tool.move": ("G",),
            "tool.rotate": ("R",),
            "tool.scale": ("S",),
            "tool.brush": ("Shift+X",),
            "edit.delete": ("X", "Delete"),
            "move.duplicate": ("Shift+D",),
            "select.all": ("A",),
            "select.none": ("Escape", "Alt+A"),
            "select.codeword": ("Shift+Y",),
            "edit.redo": ("Ctrl+Shift+Z",),
            "edit.solo": ("/",),
        },
    ),
    "unreal": KeyPreset(
        "Unreal",
        (
            CameraDrag(LEFT, "orbit"),
            CameraDrag(LEFT, "orbit", "Alt"),
            CameraDrag(RIGHT, "look"),
            CameraDrag(RIGHT, "dolly", "Alt"),
            CameraDrag(MIDDLE, "pan"),
        ),
        flies_always=False,
        keys={
            "tool.pick": ("Q", "V"),
            "tool.move": ("W",),
            "tool.rotate": ("E",),
            "tool.scale": ("R",),
            "edit.show_all": ("Ctrl+H",),
            "move.put_on_ground": ("End",),
        },
    ),
}
"""Presets by the names under which preferences keep them."""
DEFAULT_PRESET = "instdrive"


def merge_keys(usual: Keys, preset: KeyPreset, own: Keys) -> dict[str, tuple[str, ...]]:
    """Merge the actions' usual keys with a preset's and the user's own, which come first.

    A key that a preset or the user has given away does nothing else.
    """
    merged = {name: preset.keys.get(name, keys) for name, keys in usual.items()}
    given = {key for name, keys in preset.keys.items() if name in usual for key in keys}
    merged = {
        name: tuple(key for key in keys if name in preset.keys or key not in given) for name, keys in merged.items()
    }
    chosen = {name: keys for name, keys in own.items() if name in usual}
    taken = {key for keys in chosen.values() for key in keys}
    return {name: chosen.get(name, tuple(key for key in keys if key not in taken)) for name, keys in merged.items()}


def is_shortcut(text: str) -> bool:
    """Whether a text names a key with or without modifiers, e.g. ``Ctrl+Shift+Z``."""
    *modifiers, key = text.split("+")
    return key in KEY_NAMES and len(set(modifiers)) == len(modifiers) and {*modifiers} <= {"Ctrl", "Shift", "Alt"}


def find_owner(keys: Keys, shortcut: str, but: str) -> str | None:
    """Find the action, other than `but`, that has a shortcut; None where it is free."""
    return next((name for name, held in keys.items() if shortcut in held and name != but), None)


def write_keys(path: Path, preset: str, own: Keys) -> None:
    """Write a preset's name and the user's own keys as JSON. Raises DataError where the file cannot be written."""
    content = {"preset": preset, "keys": {name: list(keys) for name, keys in own.items()}}
    write_bytes(path, json.dumps(content, indent=1).encode())


def read_keys(path: Path, known: Keys) -> tuple[str, dict[str, tuple[str, ...]]]:
    """Read what `write_keys` has written, for the actions `known`.

    Raises DataError, naming the file and what is wrong, where it is something else or gives one key to two actions.
    """
    try:
        stored = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise DataError(
            path, phrase("these keys cannot be read ({error})", error=error), "Choose a file that Preferences exported"
        ) from error
    if not isinstance(stored, dict) or not isinstance(stored.get("keys"), dict) or stored.get("preset") not in PRESETS:
        raise DataError(path, "fields 'preset' and 'keys' are missing", "Choose a file that Preferences exported")
    own: dict[str, tuple[str, ...]] = {}
    for name, keys in stored["keys"].items():
        if name not in known:
            raise DataError(path, phrase("there is no command {name!r}", name=name), "Delete its line")
        if not isinstance(keys, list) or not all(isinstance(key, str) for key in keys):
            raise DataError(
                path,
                phrase("keys of {name!r} must be a list of texts, not {keys!r}", name=name, keys=keys),
                "Write keys like ['Ctrl+D']",
            )
        for key in keys:
            if not is_shortcut(key):
                raise DataError(
                    path,
                    phrase("there is no key {key!r} ({name!r})", key=key, name=name),
                    "Write keys like 'Ctrl+Shift+D' or 'F5'",
                )
            if (owner := find_owner(own, key, name)) is not None:
                raise DataError(
                    path,
                    phrase("{key} is the key of {owner!r} and of {name!r}", key=key, owner=owner, name=name),
                    "Keep one of them",
                )
        own[name] = tuple(keys)
    return stored["preset"], own
