"""File locks that tell whether a running process holds a file: the system drops them however their holder dies.

A process number in a file would do for most cases, but numbers are given out again, and differ between containers that
share a folder.
"""

from __future__ import annotations

import errno
import os
import sys
from pathlib import Path

_UNSUPPORTED = {errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOLCK, errno.ENOSYS, errno.EINVAL}


def lock(descriptor: int) -> bool | None:
    """Take the lock of an open file without waiting: True = taken, until the descriptor is closed; False = another
    holds it; None = this file system has no locks.
    """
    try:
        if sys.platform == "win32":
            import msvcrt

            # Far beyond any content: Windows refuses reads and writes of locked bytes.
            os.lseek(descriptor, 1 << 30, os.SEEK_SET)
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in _UNSUPPORTED:
            return None
        if error.errno in (errno.EAGAIN, errno.EACCES, errno.EDEADLK):
            return False
        raise
    return True


class FileLock:
    """A lock file held by this process."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor: int | None = descriptor

    @classmethod
    def acquire(cls, path: Path) -> FileLock | None:
        """Lock a file, made where missing; None where another process, or another lock of this one, holds it.

        A file system without locks counts as free. Raises OSError where the file cannot be opened.
        """
        descriptor = os.open(path, os.O_CREAT | os.O_RDWR, 0o600)
        if lock(descriptor) is False:
            os.close(descriptor)
            return None
        return cls(descriptor)

    def release(self) -> None:
        """Release the lock; the file stays. A second call changes nothing."""
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None
