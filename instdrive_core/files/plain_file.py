"""Opening only files that end, and taking no more memory than they hold."""

from __future__ import annotations

import errno
import io
import os
import stat
from pathlib import Path


def require_plain_file(path: Path) -> Path:
    """Return the path, unless it is a pipe, socket or device: those may keep a reader waiting, or never end.

    Raises OSError for these. A missing file or a folder passes: opening it says what is wrong.
    """
    try:
        mode = path.stat().st_mode
    except OSError:
        return path
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise OSError(errno.EINVAL, "it is a pipe, socket or device, not a file", str(path))
    return path


class BoundedReader(io.BufferedReader):
    """A file for libraries that read as much as its content promises; Python would take that memory first."""

    def __init__(self, path: Path) -> None:
        """Open a file. Raises OSError where it cannot be opened, or is a pipe or device."""
        super().__init__(io.FileIO(require_plain_file(path)))

    def read(self, size: int | None = -1, /) -> bytes:
        """Read `size` bytes, or what is left of the file where that is less."""
        left = max(os.fstat(self.fileno()).st_size - self.tell(), 0)
        return super().read(left if size is None or size < 0 else min(size, left))
