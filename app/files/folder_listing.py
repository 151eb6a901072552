"""Listing a folder for the file browser."""

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
    """Whether it can be opened as a scene; otherwise it is a folder to enter."""
    size: int | None
    """Bytes; None for folders."""
    changed: float
    """Seconds since 1970."""

    @property
    def size_text(self) -> str:
        """Size such as ``4.2 MB``; empty for folders."""
        if self.size is None:
            return ""
        value, unit = float(self.size), 0
        while value >= 1000 and unit < len(_UNITS) - 1:
            value, unit = value / 1000, unit + 1
        return f"{value:.0f} {_UNITS[unit]}" if unit == 0 or value >= 100 else f"{value:.1f} {_UNITS[unit]}"

    @property
    def changed_text(self) -> str:
        """Local date and time of the last change, to the minute."""
        return datetime.fromtimestamp(self.changed).strftime("%Y-%m-%d %H:%M")


def list_folder(folder: Path, suffixes: tuple[str, ...], holds_scene: Callable[[Path], bool]) -> list[FolderEntry]:
    """List folders, then files with one of the endings (lower case), each by name.

    Hidden entries are left out, as are names that cannot be shown because they are not UTF-8 text. A folder that
    cannot be read lists nothing. `holds_scene` tells scene folders from those to enter.
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
    except OSError:  # deleted in the meantime, or a link to nowhere
        return None
    if not path.name.lower().endswith(suffixes):
        return None
    return FolderEntry(path, True, status.st_size, status.st_mtime)
