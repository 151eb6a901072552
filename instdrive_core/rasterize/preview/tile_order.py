"""The splats of one tile of a preview, nearest first.

Tiles are sorted one by one, while their lists are in a core's own cache, and only where they are drawn: that takes less
than sorting all splats first, and lists can be made in the order of rows, which reads memory from front to back.
"""

from __future__ import annotations

import numba
import numpy as np

from instdrive_core.rasterize.kernels.fragment import FAST

KEY = np.uint64(32)
"""An entry of a list is its splat and, beyond these bits, the bits of its depth, which compare as depths do."""
_SPLAT = np.uint64(0xFFFFFFFF)
_DIGIT = np.uint64(9)
"""Most bits of a digit."""
_PASSES = np.uint64(4)
_FEW = np.uint64(32)
"""Entries up to which they are put in their places one by one."""
_STEPS = np.uint64(8)
"""Steps per entry after which putting them in their places is given up."""


@numba.njit(cache=True, error_model="numpy")
def new_counters():
    """Make room for the counters of all passes."""
    return np.empty(np.int64(_PASSES << _DIGIT), np.uint32)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def order_tile(entries, start, stop, counters, room, splats, first):
    """Write the splats of a tile's entries to `splats` from `first` on: nearest first, equal depths in rising order.

    The entries lie in rising order of their splats. `room` is for twice as many.
    """
    count, one, two = stop - start, np.uint64(1), np.uint64(2)
    if count <= _FEW:
        for k in range(count):
            room[k] = entries[start + k]
        _insert(room, np.uint64(0), count, count * count, splats, first)
        return
    low, high = ~np.uint64(0), np.uint64(0)
    for place in range(start, stop):
        low, high = min(low, entries[place]), max(high, entries[place])
    low = (low >> KEY) << KEY
    span, bits = (high - low) >> KEY, np.uint64(0)
    while span >> bits:
        bits += one
    # Two digits put almost all in their places: more for more entries.
    digit = np.uint64(5)
    while count >> (digit + two) and digit < _DIGIT:
        digit += one
    rest = bits - min(bits, two * digit)
    _sort_by_digits(entries, start, count, low, KEY + rest, digit, two, counters, room)
    if _insert(room, np.uint64(0), count, _STEPS * count, splats, first):
        return
    passes = (bits + _DIGIT - one) // _DIGIT
    _sort_by_digits(entries, start, count, low, KEY, _DIGIT, passes, counters, room)
    at = np.uint64(0) if passes % two == np.uint64(0) else count
    _insert(room, at, count, count, splats, first)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _sort_by_digits(entries, start, count, low, lowest, digit, passes, counters, room):
    """Sort entries less `low` by some digits from bit `lowest` on; the result lies in the first half of `room` after
    an even number of passes, else in the second."""
    one, size = np.uint64(1), np.uint64(1) << digit
    mask = size - one
    for k in range(passes * size):
        counters[k] = np.uint32(0)
    for place in range(start, start + count):
        key = (entries[place] - low) >> lowest
        for k in range(passes):
            counters[k * size + ((key >> (k * digit)) & mask)] += np.uint32(1)
    source, target = np.uint64(0), count
    for k in range(passes):
        shift, counter, total = lowest + k * digit, k * size, np.uint32(0)
        for place in range(counter, counter + size):
            number = counters[place]
            counters[place] = total
            total += number
        for place in range(count):
            entry = entries[start + place] if k == np.uint64(0) else room[source + place]
            at = counter + (((entry - low) >> shift) & mask)
            rank = np.uint64(counters[at])
            counters[at] += np.uint32(1)
            room[target + rank] = entry
        source, target = target, count - target


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _insert(room, at, count, steps, splats, first):
    """Put entries from place `at` on in order, in at most so many steps; returns whether they sufficed. Then their
    splats are written."""
    one = np.uint64(1)
    for k in range(at + one, at + count):
        entry, place = room[k], k
        while place > at and room[place - one] > entry:
            room[place] = room[place - one]
            place -= one
        room[place] = entry
        if k - place > steps:
            return False
        steps -= k - place
    for k in range(count):
        splats[first + k] = np.int32(room[at + k] & _SPLAT)
    return True
