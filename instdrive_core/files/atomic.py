"""Files that are whole or absent: write beside, flush to the disk, rename."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import BinaryIO

from instdrive_core.errors import DataError
from instdrive_core.files.plain_file import require_plain_file
from instdrive_core.files.temporaries import create_temporary

Check = Callable[[Path, Path], None]
"""Gets a finished temporary file and the name that it is about to take; raises DataError to keep it from that."""
_check: ContextVar[Check | None] = ContextVar("check before replacing", default=None)


@contextmanager
def check_before_replacing(check: Check) -> Iterator[None]:
    """Run `check` on every file written inside the block, before it takes the place of an old one."""
    outer = _check.set(check)
    try:
        yield
    finally:
        _check.reset(outer)


@contextmanager
def replace_atomically(path: str | Path, temporary_for: str | None = None) -> Iterator[Path]:
    """Give a file name beside `path` to write to; that file replaces `path` when the block ends without an error.

    At any moment, also after a power cut, `path` is the old file or the new one, whole. Missing folders are made. What
    an earlier writer of the same name left behind when it was killed is removed. A link stays: what it leads to is
    replaced.

    Args:
        path: the file to be written.
        temporary_for: the name by which that writer is known, where `path` has a new name each time.

    Raises DataError where the system does not let it be written (no space, no permission).
    """
    path = Path(path)
    try:
        path = require_plain_file(Path(os.path.realpath(path)) if path.is_symlink() else path)
        path.parent.mkdir(parents=True, exist_ok=True)
        with create_temporary(path.with_name(temporary_for or path.name)) as temporary:
            mode = temporary.path.stat().st_mode
            yield temporary.path
            with temporary.path.open("rb+") as file:
                os.fsync(file.fileno())
            check = _check.get()
            if check is not None:
                check(temporary.path, path)
            if path.exists():
                mode = path.stat().st_mode
            temporary.path.chmod(stat.S_IMODE(mode))  # libraries that write by name may have made it private
            temporary.replace(path)
            sync_folder(path.parent)
    except OSError as error:
        problem = f"the file cannot be written ({error.strerror or error})"
        raise DataError(path, problem, "Free some space or choose another place") from error


@contextmanager
def open_atomically(path: str | Path) -> Iterator[BinaryIO]:
    """Open a binary file to be written that replaces `path` when the block ends without an error."""
    with replace_atomically(path) as temporary, temporary.open("wb") as file:
        yield file


def write_bytes(path: str | Path, content: bytes) -> None:
    """Write a small file atomically."""
    with open_atomically(path) as file:
        file.write(content)


def sync_folder(folder: Path) -> None:
    """Make renames in a folder survive a power cut, where the system can (not on Windows)."""
    if os.name != "posix":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
