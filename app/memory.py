"""Measuring the editor's memory, and returning freed memory to the system."""

from __future__ import annotations

import ctypes
import sys
import time
from functools import cache

import psutil

LOOK_SECONDS = 1.0
"""Time between two looks."""


class MemoryGauge:
    """Resident bytes of this process, looked up at most once a second."""

    def __init__(self) -> None:
        self._bytes = 0
        self._next = 0.0

    @property
    def resident(self) -> int:
        """Bytes that were in memory at the last look."""
        now = time.monotonic()
        if now >= self._next:
            self._bytes, self._next = read_resident_bytes(), now + LOOK_SECONDS
        return self._bytes


def read_resident_bytes() -> int:
    """Read how many bytes of this process are in memory now."""
    return psutil.Process().memory_info().rss


def release_freed_memory() -> None:
    """Return the freed memory that the C library keeps to the system.

    After hours of large jobs on several threads that would be as much as the scene itself. Works with glibc on Linux
    only; elsewhere it does nothing.
    """
    trim = _find_trim()
    if trim is not None:
        trim(0)


@cache
def _find_trim():
    if not sys.platform.startswith("linux"):
        return None
    return getattr(ctypes.CDLL(None), "malloc_trim", None)
