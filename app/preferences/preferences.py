"""What the user has chosen in Preferences, kept in a file from session to session."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from instdrive_app.language.languages import CHOICES, SYSTEM
from instdrive_app.preferences.key_presets import DEFAULT_PRESET, PRESETS, Keys, is_shortcut
from instdrive_app.preferences.themes import DEFAULT_THEME, THEMES
from instdrive_core.errors import DataError
from instdrive_core.files.atomic import write_bytes
from instdrive_core.wording import phrase

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Preferences:
    """Everything that can be chosen."""

    theme: str = DEFAULT_THEME
    """A name of `THEMES`."""
    safe_colors: bool = False
    """Whether instances are shown in colours that colour-blind eyes tell apart."""
    knows_first_steps: bool = False
    """Whether the first steps were shown and closed."""
    preset: str = DEFAULT_PRESET
    """A name of `PRESETS`: the keys and mouse gestures."""
    language: str = SYSTEM
    """One of `CHOICES`: a language of the window, or that of the desktop."""
    keys: Keys = field(default_factory=dict)
    """The user's own keys, by IDs of actions."""


def read_preferences(stored: Any, report: Callable[[str], None]) -> Preferences:
    """Read preferences as `asdict` stores them; what does not fit is reported and left at its default."""
    chosen = Preferences()
    if not isinstance(stored, Mapping):
        report(phrase("a list of choices was expected, not {kind}", kind=type(stored).__name__))
        return chosen
    stored = {**stored, "keys": _read_own_keys(stored.get("keys"))}
    for name, fits in _FITS.items():
        value = stored.get(name, getattr(chosen, name))
        if fits(value):
            chosen = replace(chosen, **{name: value})
        else:
            report(phrase("{name} cannot be {value!r}", name=name, value=value))
    return chosen


def _read_own_keys(stored: Any) -> Keys | None:
    """Read own keys; None if there is anything else among them."""
    if not isinstance(stored, Mapping):
        return {} if stored is None else None
    lists = all(isinstance(keys, list) for keys in stored.values())
    if not lists or not all(isinstance(key, str) and is_shortcut(key) for keys in stored.values() for key in keys):
        return None
    return {str(name): tuple(keys) for name, keys in stored.items()}


_FITS: dict[str, Callable[[Any], bool]] = {
    "theme": lambda value: isinstance(value, str) and value in THEMES,
    "safe_colors": lambda value: isinstance(value, bool),
    "knows_first_steps": lambda value: isinstance(value, bool),
    "preset": lambda value: isinstance(value, str) and value in PRESETS,
    "language": lambda value: isinstance(value, str) and value in CHOICES,
    "keys": lambda value: value is not None,
}
"""For each field, whether a stored value fits it."""


@dataclass
class PreferenceStore:
    """The present choices, and the file that keeps them. Where it cannot be read or written, that is only logged."""

    file: Path
    current: Preferences = field(init=False)

    def __post_init__(self) -> None:
        self.current = self._read()

    def change(self, **values: Any) -> None:
        """Choose something else, and keep it."""
        changed = replace(self.current, **values)
        if changed == self.current:
            return
        self.current = changed
        try:
            write_bytes(self.file, json.dumps(asdict(changed), indent=1).encode())
        except DataError:
            _log.warning("the preferences were not written", exc_info=True)

    def _read(self) -> Preferences:
        try:
            stored = json.loads(self.file.read_text(encoding="utf-8"))
        except FileNotFoundError:
            return Preferences()
        except (OSError, ValueError):
            _log.warning("the preferences %s cannot be read", self.file, exc_info=True)
            return Preferences()
        return read_preferences(stored, lambda fault: _log.warning("preferences %s: %s", self.file, fault))
