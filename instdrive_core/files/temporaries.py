"""Temporary files that no killed writer leaves behind for good.

The temporary file of ``a.ply`` is ``.a.ply.0.tmp``, or has the next number where another writer is at work. A writer
holds its file open and, where the system has such locks, locked; so the next writer of the same name can tell an
abandoned file from one in use, and removes it.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from instdrive_core.files.file_lock import lock

_CREATE = os.O_CREAT | os.O_EXCL | os.O_RDWR
_REOPEN = os.O_RDWR | getattr(os, "O_NOFOLLOW", 0)
_POSIX = os.name == "posix"


@dataclass
class Temporary:
    """A temporary file that this writer uses."""

    path: Path
    _descriptor: int
    _is_replaced: bool = False

    def replace(self, target: Path) -> None:
        """Give the file its final name."""
        if not _POSIX:
            self._close_descriptor()  # Windows renames no open file
        self.path.replace(target)
        self._is_replaced = True

    def close(self) -> None:
        """Remove the file, unless it has its final name: the old one may be another writer's by then."""
        if not _POSIX:
            self._close_descriptor()
        if not self._is_replaced:
            self.path.unlink(missing_ok=True)  # while it is locked, so that the name is still ours
        self._close_descriptor()

    def _close_descriptor(self) -> None:
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1


@contextmanager
def create_temporary(path: Path) -> Iterator[Temporary]:
    """Create an empty file beside `path`, which is removed at the end unless it was renamed. Raises OSError."""
    temporary = _claim(path)
    try:
        yield temporary
    finally:
        temporary.close()


def _claim(path: Path) -> Temporary:
    for number in itertools.count():
        temporary = _name_with_number(path, number)
        while True:
            try:
                descriptor = os.open(temporary, _CREATE, 0o666)
            except FileExistsError:
                if _is_free(temporary):
                    continue
                break  # another writer is at work: the next number
            # Between the two calls another writer may take the file for abandoned.
            if lock(descriptor) is not False and _is_at(temporary, descriptor):
                _remove_abandoned(path, number + 1)
                return Temporary(temporary, descriptor)
            os.close(descriptor)
    raise AssertionError("numbers do not end")


def _name_with_number(path: Path, number: int) -> Path:
    return path.with_name(f".{path.name}.{number}.tmp")


def _remove_abandoned(path: Path, first: int) -> None:
    """Remove abandoned files with higher numbers: several writers of one name may have been killed at once."""
    for number in itertools.count(first):
        temporary = _name_with_number(path, number)
        if not temporary.exists() or not _is_free(temporary):
            return


def _is_free(temporary: Path) -> bool:
    """Whether no file has this name, after an abandoned one is removed."""
    try:
        if not _POSIX:
            temporary.unlink(missing_ok=True)  # Windows refuses where the file is open anywhere
            return True
        descriptor = os.open(temporary, _REOPEN)
    except FileNotFoundError:
        return True
    except OSError:
        return False
    try:
        if lock(descriptor) is not True:
            return False
        if _is_at(temporary, descriptor):
            temporary.unlink()
        return True
    finally:
        os.close(descriptor)


def _is_at(path: Path, descriptor: int) -> bool:
    """Whether the open file still has this name."""
    try:
        return os.path.samestat(os.lstat(path), os.fstat(descriptor))
    except FileNotFoundError:
        return False
