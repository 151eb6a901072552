"""How much memory the editor holds."""

from __future__ import annotations

import time
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
            self._bytes, self._next = resident_bytes(), now + LOOK_SECONDS
        return self._bytes


def resident_bytes() -> int | None:
    """What of this process is in memory now, in bytes; None where the system does not say."""
    try:
        return int(STATM.read_text().split()[1]) * PAGE_BYTES
    except (OSError, ValueError, IndexError):
        return None
