"""Folders of many files that are whole or absent: filled beside, then renamed."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from instdrive_core.errors import DataError
from instdrive_core.files.atomic import sync_folder
from instdrive_core.files.file_lock import FileLock

_LOCK = ".lock"


@contextmanager
def fill_new_folder(path: Path) -> Iterator[Path]:
    """Give an empty folder beside `path` to fill; it becomes `path` when the block ends without an error.

    Otherwise nothing is left of it. Missing parents are made. What an earlier writer of the same name left behind when
    it was killed is removed.

    Raises DataError where `path` has files already, where another writer is at it, or where the system does not let it
    be written (no space, no permission).
    """
    path = path.absolute()
    part = path.with_name(f".{path.name}.part")
    try:
        if path.exists() and (not path.is_dir() or any(path.iterdir())):
            raise DataError(path, "is not an empty folder, and nothing in it is replaced", "Name a new folder")
        part.mkdir(parents=True, exist_ok=True)
        held = FileLock.acquire(part / _LOCK)
        if held is None:
            raise DataError(path, "another program is writing it", "Wait for that, or name another folder")
        try:
            _clear(part)
            yield part
            (part / _LOCK).unlink()
            held.release()  # Windows renames no folder with an open file
            if path.is_dir():
                path.rmdir()
            part.rename(path)
            sync_folder(path.parent)
        except BaseException:
            shutil.rmtree(part, ignore_errors=True)
            raise
        finally:
            held.release()
    except OSError as error:
        problem = f"the folder cannot be written ({error.strerror or error})"
        raise DataError(path, problem, "Free some space or choose another place") from error


def _clear(part: Path) -> None:
    for old in part.iterdir():
        if old.is_dir() and not old.is_symlink():
            shutil.rmtree(old)
        elif old.name != _LOCK:
            old.unlink()
