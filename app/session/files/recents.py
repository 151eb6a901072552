"""The scenes and projects opened last, remembered from session to session."""

from __future__ import annotations

import json
import logging
import os.path
from pathlib import Path

from instdrive_core.errors import DataError
from instdrive_core.files.atomic import write_bytes

MAX_RECENTS = 10
_log = logging.getLogger(__name__)


class RecentFiles:
    """A list in a file, newest first. Where it cannot be read or written, that is only logged."""

    def __init__(self, file: Path) -> None:
        self._file = file

    @property
    def paths(self) -> tuple[Path, ...]:
        """The paths that still exist, newest first."""
        return tuple(path for path in self._read_list() if os.path.exists(path))

    def add(self, path: Path) -> None:
        """Put a path at the top of the list."""
        path = path.absolute()
        self._write([path, *(other for other in self._read_list() if other != path)][:MAX_RECENTS])

    def _write(self, listed: list[Path]) -> None:
        try:
            write_bytes(self._file, json.dumps([str(entry) for entry in listed], indent=1).encode())
        except DataError:
            _log.warning("the list of recent files was not written", exc_info=True)

    def remove(self, path: Path) -> None:
        """Take a path off the list."""
        self._write([other for other in self._read_list() if other != path.absolute()])

    def clear(self) -> None:
        """Empty the list."""
        self._file.unlink(missing_ok=True)

    def _read_list(self) -> list[Path]:
        try:
            listed = json.loads(self._file.read_text(encoding="utf-8"))
        except FileNotFoundError:
            return []
        except (OSError, ValueError):
            _log.warning("the list of recent files %s cannot be read", self._file, exc_info=True)
            return []
        return [Path(entry) for entry in listed if isinstance(entry, str)] if isinstance(listed, list) else []
