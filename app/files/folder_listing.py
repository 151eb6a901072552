"""What the file browser lists of a folder."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from instdrive_app.files.file_names import is_displayable

_UNITS = ("B", "kB", "MB", "GB", "TB")


@dataclass(frozen=True)
class FolderEntry:
    """A file or folder."""

    path: Path
    is_scene: bool
    """Whether it can be opened; otherwise it is a folder to go into."""
    size: int | None
    """Bytes; None for folders."""
    changed: float
    """Seconds since 1970."""

    @property
    def size_text(self) -> str:
        """``4.2 MB``; empty for folders."""
        if self.size is None:
            return ""
        value, unit = float(self.size), 0
        while value >= 1000 and unit < len(_UNITS) - 1:
            value, unit = value / 1000, unit + 1
        return f"{value:.0f} {_UNITS[unit]}" if unit == 0 or value >= 100 else f"{value:.1f} {_UNITS[unit]}"

    @property
    def changed_text(self) -> str:
        """Local date and time, to the minute."""
        return datetime.fromtimestamp(self.changed).strftime("%Y-%m-%d %H:%M")


def list_folder(folder: Path, suffixes: tuple[str, ...], holds_scene: Callable[[Path], bool]) -> list[FolderEntry]:
    """Folders, then files with one of the endings (lower case), each by name.

    Left out is what is hidden, and what has a name that cannot be shown because it is no UTF-8 text.

    Nothing where the folder cannot be read. `holds_scene` tells folders that are scenes from those to go into.
    """
    try:
        found = [path for path in folder.iterdir() if not path.name.startswith(".") and is_displayable(path)]
    except OSError:
        return []
    entries = [entry for path in found if (entry := _create_entry(path, suffixes, holds_scene)) is not None]
    return sorted(entries, key=lambda entry: (entry.size is not None, entry.path.name.lower()))


def _create_entry(path: Path, suffixes: tuple[str, ...], holds_scene: Callable[[Path], bool]) -> FolderEntry | None:
    try:
        status = path.stat()
        if path.is_dir():
            return FolderEntry(path, holds_scene(path), None, status.st_mtime)
    except OSError:  # gone meanwhile, or a link to nowhere
        return None
    if not path.name.lower().endswith(suffixes):
        return None
    return FolderEntry(path, True, status.st_size, status.st_mtime)
