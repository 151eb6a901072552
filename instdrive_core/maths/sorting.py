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
    count, low, high = _survey_chunk(depths, near, 0, len(depths))
    rows, half_rows = np.empty(count, np.int32), np.empty(count, np.int32)
    if count == 0:
        return rows
    keys, half_keys = np.empty(count, np.uint32), np.empty(count, np.uint32)
    digits = _choose_digits(low, high)
    counters = np.zeros((1, 1 << digits), np.int32)
    _compact_chunk(depths, near, np.uint32(low), 0, len(depths), 0, rows, keys, counters[0])
    _turn_into_cursors(counters)
    _scatter_chunk(rows, keys, 0, count, 0, counters[0], half_rows, half_keys)
    counters[:] = 0
    _count_chunk(half_keys, 0, count, digits, counters[0])
    _turn_into_cursors(counters)
    _scatter_chunk(half_rows, half_keys, 0, count, digits, counters[0], rows, keys)
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
    """Turn counts into where each chunk's first entry of a digit goes: digit by digit, within it chunk by chunk."""
    place = np.int32(0)
    for digit in range(counters.shape[1]):
        for chunk in range(counters.shape[0]):
            count = counters[chunk, digit]
            counters[chunk, digit] = place
            place += count


@numba.njit(cache=True, nogil=True, error_model="numpy")
@no_type_check
def _survey_chunk(depths, near, start, stop):
    """Count the depths that matter; returns their number, and the least and the greatest of their bits."""
    bits = depths.view(np.uint32)
    number, low, high = np.int64(0), np.int64(0xFFFFFFFF), np.int64(0)
    for row in range(start, stop):
        if near < depths[row] < np.float32(np.inf):
            number += 1
            low, high = min(low, np.int64(bits[row])), max(high, np.int64(bits[row]))
    return number, low, high


@numba.njit(cache=True, nogil=True, error_model="numpy")
@no_type_check
def _compact_chunk(depths, near, base, start, stop, first, rows, keys, counters):
    """Write the rows that count and their keys from place `first` on, and count the keys' lower digits."""
    bits, mask, place = depths.view(np.uint32), np.uint32(len(counters) - 1), np.uint64(first)
    for row in range(start, stop):
        if near < depths[row] < np.float32(np.inf):
            key = np.uint32(bits[row] - base)
            rows[place], keys[place] = row, key
            counters[np.uint64(key & mask)] += 1
            place += np.uint64(1)


@numba.njit(cache=True, nogil=True, error_model="numpy")
@no_type_check
def _count_chunk(keys, start, stop, shift, counters):
    mask = np.uint32(len(counters) - 1)
    for place in range(np.uint64(start), np.uint64(stop)):
        counters[np.uint64((keys[place] >> np.uint32(shift)) & mask)] += 1


@numba.njit(cache=True, nogil=True, error_model="numpy")
@no_type_check
def _scatter_chunk(rows, keys, start, stop, shift, cursors, out_rows, out_keys):
    mask = np.uint32(len(cursors) - 1)
    for place in range(np.uint64(start), np.uint64(stop)):
        digit = np.uint64((keys[place] >> np.uint32(shift)) & mask)
        target = np.uint64(cursors[digit])
        cursors[digit] += 1
        out_rows[target], out_keys[target] = rows[place], keys[place]
