"""File names as the user reads them."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from instdrive_core.wording import format_count

NAMED = 3
"""Number of files listed by name; the others are counted."""


def is_displayable(path: Path) -> bool:
    """Whether the path is UTF-8 text and can be shown; on Linux names are bytes of any encoding."""
    return str(path) == format_path(path)


def format_path(path: Path | str) -> str:
    """Format the path, with U+FFFD for bytes that are no text."""
    return os.fsencode(path).decode("utf-8", "replace")


def find_name_problem(path: Path) -> str:
    """Say why a path cannot be shown in recent files, titles and messages; empty where it can."""
    if is_displayable(path):
        return ""
    return f"{format_path(path.name or path)} cannot be opened: its path is not UTF-8 text. Rename it, then try again"


def find_working_folder() -> Path:
    """Find the folder where the program was started; the user's home where that is gone or cannot be shown."""
    try:
        folder = Path.cwd()
    except OSError:
        return Path.home()
    return folder if is_displayable(folder) else Path.home()


def join_names(paths: Sequence[Path]) -> str:
    """Join file names, e.g. ``a.ply``, ``a.ply and b.ply``, ``a.ply, b.ply, c.ply and 4 others``."""
    names = [path.name for path in paths]
    if len(names) > NAMED + 1:
        names = [*names[:NAMED], format_count(len(names) - NAMED, "other")]
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
