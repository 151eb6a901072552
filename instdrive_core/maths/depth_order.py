"""The order of depths, nearest first, by two parallel passes of a counting sort whose digits fit the depths' range."""

from __future__ import annotations

from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Float32, Int32
from numpy import ndarray

from instdrive_core.maths.workspace import Workspace

_CHUNKS = 4
"""Rows are dealt to this many parallel counters; the result does not depend on it."""


def nearest_first(depths: Float32[ndarray, " n"], workspace: Workspace) -> Int32[ndarray, " m"]:
    """Rows of the depths above 0, nearest first; equal depths in rising row order, non-finite ones left out.

    The answer lies in the workspace: it lasts until the next call with the same one.
    """
    kept, lowest, highest = (np.zeros(_CHUNKS, np.int64) for _ in range(3))
    _survey(depths, kept, lowest, highest)
    total = int(kept.sum())
    if total == 0:
        return np.zeros(0, np.int32)
    base = int(lowest[kept > 0].min())
    digits = max(1, -(-(int(highest.max()) - base).bit_length() // 2))
    first = np.concatenate([np.zeros(1, np.int64), np.cumsum(kept)])
    rows, half_rows = (workspace.array(f"order {name}", (total,), np.int32) for name in "ab")
    keys, half_keys = (workspace.array(f"order keys {name}", (total,), np.uint32) for name in "ab")
    counters = np.zeros((_CHUNKS, 1 << digits), np.int32)
    _compact(depths, np.uint32(base), first, rows, keys, counters)
    _to_cursors(counters)
    _scatter(rows, keys, first, 0, counters, half_rows, half_keys)
    even = np.arange(_CHUNKS + 1) * total // _CHUNKS
    counters[:] = 0
    _count(half_keys, even, digits, counters)
    _to_cursors(counters)
    _scatter(half_rows, half_keys, even, digits, counters, rows, keys)
    return rows


@numba.njit(cache=True, nogil=True, error_model="numpy")
@no_type_check  # the tests' shape checks cannot be compiled
def _to_cursors(counters):
    """From counts to where each chunk's first entry of a digit goes: digit by digit, within it chunk by chunk."""
    place = np.int32(0)
    for digit in range(counters.shape[1]):
        for chunk in range(_CHUNKS):
            count = counters[chunk, digit]
            counters[chunk, digit] = place
            place += count


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
@no_type_check  # the tests' shape checks cannot be compiled
def _survey(depths, kept, lowest, highest):
    count, bits = len(depths), depths.view(np.uint32)  # positive floats compare as their bits do
    for chunk in numba.prange(_CHUNKS):
        number, low, high = np.int64(0), np.int64(0xFFFFFFFF), np.int64(0)
        for row in range(count * chunk // _CHUNKS, count * (chunk + 1) // _CHUNKS):
            if np.float32(0) < depths[row] < np.float32(np.inf):
                number += 1
                low, high = min(low, np.int64(bits[row])), max(high, np.int64(bits[row]))
        kept[chunk], lowest[chunk], highest[chunk] = number, low, high


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
@no_type_check  # the tests' shape checks cannot be compiled
def _compact(depths, base, first, rows, keys, counters):
    count = len(depths)
    bits, mask = depths.view(np.uint32), np.uint32(counters.shape[1] - 1)
    for chunk in numba.prange(_CHUNKS):
        place = np.uint64(first[chunk])
        for row in range(count * chunk // _CHUNKS, count * (chunk + 1) // _CHUNKS):
            if np.float32(0) < depths[row] < np.float32(np.inf):
                key = np.uint32(bits[row] - base)
                rows[place], keys[place] = row, key
                counters[chunk, np.uint64(key & mask)] += 1
                place += np.uint64(1)


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
@no_type_check  # the tests' shape checks cannot be compiled
def _count(keys, bounds, shift, counters):
    mask = np.uint32(counters.shape[1] - 1)
    for chunk in numba.prange(_CHUNKS):
        for place in range(np.uint64(bounds[chunk]), np.uint64(bounds[chunk + 1])):
            counters[chunk, np.uint64((keys[place] >> np.uint32(shift)) & mask)] += 1


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
@no_type_check  # the tests' shape checks cannot be compiled
def _scatter(rows, keys, bounds, shift, cursors, out_rows, out_keys):
    mask = np.uint32(cursors.shape[1] - 1)
    for chunk in numba.prange(_CHUNKS):
        for place in range(np.uint64(bounds[chunk]), np.uint64(bounds[chunk + 1])):
            digit = np.uint64((keys[place] >> np.uint32(shift)) & mask)
            target = np.uint64(cursors[chunk, digit])
            cursors[chunk, digit] += 1
            out_rows[target], out_keys[target] = rows[place], keys[place]
