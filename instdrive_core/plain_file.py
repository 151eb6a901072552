"""Files that end: what a path leads to before it is opened."""

from __future__ import annotations

import errno
import stat
from pathlib import Path


def plain_file(path: Path) -> Path:
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
