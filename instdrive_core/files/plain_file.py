"""Files that end: what a path leads to before it is opened, and no memory for more than it holds."""

from __future__ import annotations

import errno
import io
import os
import stat
from pathlib import Path


def require_plain_file(path: Path) -> Path:
    """The same path, to be opened where no pipe, socket or device is: those may keep a reader waiting or never end.

    What is missing, or a folder, is left for opening to say. Raises OSError.
    """
    try:
        mode = path.stat().st_mode
    except OSError:
        return path
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise OSError(errno.EINVAL, "it is a pipe, socket or device, not a file", str(path))
    return path


class BoundedReader(io.BufferedReader):
    """A file for libraries that read as much as the file promises: Python takes that memory before it looks."""

    def __init__(self, path: Path) -> None:
        """Raises OSError where the file cannot be opened, or is a pipe or device."""
        super().__init__(io.FileIO(require_plain_file(path)))

    def read(self, size: int | None = -1, /) -> bytes:
        """At most what is left of the file."""
        left = max(os.fstat(self.fileno()).st_size - self.tell(), 0)
        return super().read(left if size is None or size < 0 else min(size, left))
