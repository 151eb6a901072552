"""Sorting depths by two passes of a 16-bit counting sort: exact for float32 and several times faster than argsort."""

from __future__ import annotations

from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Float32, UInt32
from numpy import ndarray

_BINS = 1 << 16


def back_to_front(depths: Float32[ndarray, " n"], near: float) -> UInt32[ndarray, " m"]:
    """Rows of depths above `near` (≥ 0), farthest first; equal depths in falling row order, non-finite ones left out.

    Reversed, this is the stable front-to-back order: nearest first, equal depths in rising row order.
    """
    return _front_to_back(np.ascontiguousarray(depths, np.float32), np.float32(max(near, 0.0)))[::-1].copy()


@numba.njit(cache=True, nogil=True)
@no_type_check  # the tests' shape checks cannot be compiled
def _front_to_back(depths: ndarray, near: float) -> ndarray:
    kept = 0
    for row in range(len(depths)):
        if near < depths[row] < np.inf:
            kept += 1
    rows, keys = np.empty(kept, np.uint32), np.empty(kept, np.uint32)
    bits = depths.view(np.uint32)  # positive floats compare as their bits do
    place = 0
    for row in range(len(depths)):
        if near < depths[row] < np.inf:
            rows[place], keys[place] = row, bits[row]
            place += 1
    low_order = _counting_pass(keys, rows, 0)
    high_order = _counting_pass(low_order[1], low_order[0], 16)
    return high_order[0]


@numba.njit(cache=True, nogil=True)
@no_type_check  # the tests' shape checks cannot be compiled
def _counting_pass(keys: ndarray, rows: ndarray, shift: int) -> tuple[ndarray, ndarray]:
    """Stable sort by 16 bits of the keys; returns rows and keys."""
    starts = np.zeros(_BINS + 1, np.int64)
    for place in range(len(keys)):
        starts[((keys[place] >> shift) & 0xFFFF) + 1] += 1
    for digit in range(_BINS):
        starts[digit + 1] += starts[digit]
    sorted_rows, sorted_keys = np.empty_like(rows), np.empty_like(keys)
    for place in range(len(keys)):
        digit = (keys[place] >> shift) & 0xFFFF
        target = starts[digit]
        starts[digit] += 1
        sorted_rows[target], sorted_keys[target] = rows[place], keys[place]
    return sorted_rows, sorted_keys
