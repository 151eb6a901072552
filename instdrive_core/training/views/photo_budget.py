"""How much memory training photos may take, and how many threads read them."""

from __future__ import annotations

import os
from collections.abc import Sequence

from instdrive_core.available_memory import measure_available_memory

BYTES_PER_PIXEL = 7
"""Bytes of colour, 16-bit label, sky, and what is solid."""
LEAST_BUDGET = 2**28
"""Bytes that photos get where memory is scarce; enough to read some of 4K ahead."""
_SHARE = 0.25
"""Share of the free memory: Gaussians grow beside the photos, and other runs may start on the same machine."""
_HALVED = 1.25
"""What a photo takes with its version of half the resolution, as a multiple of itself."""
_CORES_PER_READER, _MOST_READERS = 4, 4
"""Reading must not take the cores that train; a GPU trains with none."""


def choose_photo_budget(pixels: Sequence[int]) -> int:
    """Choose the bytes that photos of so many pixels may take: all of them stay where a quarter of the free memory
    holds them."""
    wanted = _HALVED * BYTES_PER_PIXEL * sum(pixels)
    return int(max(LEAST_BUDGET, min(wanted, _SHARE * measure_available_memory())))


def count_readers(cores: int | None = None) -> int:
    """Count the threads that read photos ahead: one for four cores, four at most, and at least one.

    `cores` are those that this process may use; None counts them.
    """
    if cores is None:
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(max(cores // _CORES_PER_READER, 1), _MOST_READERS)
