"""How much memory the editor holds, and giving back what it no longer does."""

from __future__ import annotations

import ctypes
import sys
import time
from functools import cache
from pathlib import Path

STATM = Path("/proc/self/statm")
PAGE_BYTES = 4096
LOOK_SECONDS = 1.0
"""Between two looks."""


class MemoryGauge:
    """Resident bytes of this process, looked up at most once a second; None where the system does not say."""

    def __init__(self) -> None:
        self._bytes: int | None = None
        self._next = 0.0

    @property
    def resident(self) -> int | None:
        """Bytes."""
        now = time.monotonic()
        if now >= self._next:
            self._bytes, self._next = read_resident_bytes(), now + LOOK_SECONDS
        return self._bytes


def read_resident_bytes() -> int | None:
    """What of this process is in memory now, in bytes; None where the system does not say."""
    try:
        return int(STATM.read_text().split()[1]) * PAGE_BYTES
    except (OSError, ValueError, IndexError):
        return None


def release_freed_memory() -> None:
    """Let the system have the freed memory that the C library keeps: after hours of large jobs on several threads that
    would be as much as the scene itself. Does nothing where the C library has no such call (all but Linux with glibc).
    """
    trim = _trim()
    if trim is not None:
        trim(0)


@cache
def _trim():
    if not sys.platform.startswith("linux"):
        return None
    return getattr(ctypes.CDLL(None), "malloc_trim", None)
