"""Sorting depths by two passes of a counting sort: exact for float32 and several times faster than argsort.

Positive floats compare as their bits do. What the bits of the nearest and the farthest depth differ in is split into
two digits of equal width, and the rows are sorted by the lower digit, then by the higher one.
"""

from __future__ import annotations

from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Float32, Int32, UInt32
from numpy import ndarray


def sort_front_to_back(depths: Float32[ndarray, " n"], near: float = 0.0) -> Int32[ndarray, " m"]:
    """Find the rows of depths above `near` (≥ 0), nearest first; equal depths in rising row order.

    Depths that are not finite are left out. It runs on the calling thread alone, without the interpreter's lock.
    """
    return _sort(np.ascontiguousarray(depths, np.float32), np.float32(max(near, 0.0)))


def sort_back_to_front(depths: Float32[ndarray, " n"], near: float) -> UInt32[ndarray, " m"]:
    """Find the rows of depths above `near` (≥ 0), farthest first; equal depths in falling row order.

    It is the reverse of `sort_front_to_back`.
    """
    return sort_front_to_back(depths, near)[::-1].astype(np.uint32)


@numba.njit(cache=True, nogil=True, error_model="numpy")
@no_type_check  # the tests' shape checks cannot be compiled
def _sort(depths, near):
    count, low, high = _survey(depths, near)
    rows, half_rows = np.empty(count, np.int32), np.empty(count, np.int32)
    if count == 0:
        return rows
    keys, half_keys = np.empty(count, np.uint32), np.empty(count, np.uint32)
    digits = _choose_digits(low, high)
    counters = np.zeros(1 << digits, np.int32)
    _compact(depths, near, np.uint32(low), rows, keys, counters)
    _turn_into_cursors(counters)
    _scatter(rows, keys, 0, counters, half_rows, half_keys)
    counters[:] = 0
    _count(half_keys, digits, counters)
    _turn_into_cursors(counters)
    _scatter(half_rows, half_keys, digits, counters, rows, keys)
    return rows


@numba.njit(cache=True, nogil=True)
@no_type_check
def _choose_digits(low, high):
    """Choose a digit's bits: half of those that keys from 0 to `high` - `low` have, rounded up; at least 1."""
    bits, rest = 0, high - low
    while rest > 0:
        bits, rest = bits + 1, rest >> 1
    return max(1, (bits + 1) // 2)


@numba.njit(cache=True, nogil=True, error_model="numpy")
@no_type_check
def _turn_into_cursors(counters):
    """Turn counts into where the first entry of each digit goes."""
    place = np.int32(0)
    for digit in range(len(counters)):
        count = counters[digit]
        counters[digit] = place
        place += count


@numba.njit(cache=True, nogil=True, error_model="numpy")
@no_type_check
def _survey(depths, near):
    """Count the depths that matter; returns their number, and the least and the greatest of their bits."""
    bits = depths.view(np.uint32)
    number, low, high = np.int64(0), np.int64(0xFFFFFFFF), np.int64(0)
    for row in range(len(depths)):
        if near < depths[row] < np.float32(np.inf):
            number += 1
            low, high = min(low, np.int64(bits[row])), max(high, np.int64(bits[row]))
    return number, low, high


@numba.njit(cache=True, nogil=True, error_model="numpy")
@no_type_check
def _compact(depths, near, base, rows, keys, counters):
    """Write the rows that count and their keys, and count the keys' lower digits."""
    bits, mask, place = depths.view(np.uint32), np.uint32(len(counters) - 1), np.uint64(0)
    for row in range(len(depths)):
        if near < depths[row] < np.float32(np.inf):
            key = np.uint32(bits[row] - base)
            rows[place], keys[place] = row, key
            counters[np.uint64(key & mask)] += 1
            place += np.uint64(1)


@numba.njit(cache=True, nogil=True, error_model="numpy")
@no_type_check
def _count(keys, shift, counters):
    mask = np.uint32(len(counters) - 1)
    for place in range(np.uint64(len(keys))):
        counters[np.uint64((keys[place] >> np.uint32(shift)) & mask)] += 1


@numba.njit(cache=True, nogil=True, error_model="numpy")
@no_type_check
def _scatter(rows, keys, shift, cursors, out_rows, out_keys):
    mask = np.uint32(len(cursors) - 1)
    for place in range(np.uint64(len(keys))):
        digit = np.uint64((keys[place] >> np.uint32(shift)) & mask)
        target = np.uint64(cursors[digit])
        cursors[digit] += 1
        out_rows[target], out_keys[target] = rows[place], keys[place]
