"""LZF (M. Lehmann), which .pcd files compress their points by."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy import ndarray

HIGHEST_RATIO = 90
"""Bytes that one compressed byte can stand for: 264 by a reference of three."""


@njit(cache=True)
def decompress_lzf(packed: ndarray, size: int) -> tuple[ndarray, int]:
    """Decompress bytes (m,) into `size` bytes; also how many came out, or -1 where a reference leads nowhere."""
    out = np.zeros(size, np.uint8)
    source, target = 0, 0
    while source < len(packed):
        control = int(packed[source])
        source += 1
        if control < 32:
            length = control + 1
            if source + length > len(packed) or target + length > size:
                return out, -1
            for _ in range(length):
                out[target] = packed[source]
                source += 1
                target += 1
            continue
        length = control >> 5
        if length == 7:
            if source >= len(packed):
                return out, -1
            length += int(packed[source])
            source += 1
        if source >= len(packed):
            return out, -1
        place = target - ((control & 31) << 8) - int(packed[source]) - 1
        source += 1
        length += 2
        if place < 0 or target + length > size:
            return out, -1
        for _ in range(length):
            out[target] = out[place]
            place += 1
            target += 1
    return out, target
