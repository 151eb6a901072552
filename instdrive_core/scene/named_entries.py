"""Finding the palette entries that groups of rows name, in one walk over the rows for any number of groups."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from jaxtyping import Int32, Int64, UInt16
from numpy import ndarray


class NamedEntries(NamedTuple):
    """Every pair of a part of rows and an entry that any of its rows names: by part, then by entry."""

    entries: Int64[ndarray, " k"]
    parts: Int64[ndarray, " k"]
    place: Int32[ndarray, " m"]
    """The pair of each row, in the order of the rows that were asked about."""


def find_named_entries(
    indices: UInt16[ndarray, " n"], rows: Int64[ndarray, " m"], bounds: Int64[ndarray, " p"], size: int
) -> NamedEntries:
    """Find the entries that rows name, of a palette of `size`; part k of the rows begins at ``bounds[k]``."""
    return NamedEntries(*_find_pairs(indices, rows, bounds, size))


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _find_pairs(indices, rows, bounds, size):
    parts = len(bounds) - 1
    pair_of = np.full(size, -1, np.int64)
    place = np.empty(len(rows), np.int32)
    entries, owners, count = np.empty(2 * parts + 16, np.int64), np.empty(2 * parts + 16, np.int64), 0
    for part in range(parts):
        first, last = np.uint64(bounds[part]), np.uint64(bounds[part + 1])
        alike = _number_leading_alike(indices, rows, first, last, place, count)
        if count + last - first > len(entries):
            room = np.int64(last - first) + len(entries)
            entries = np.concatenate((entries, np.empty(room, np.int64)))
            owners = np.concatenate((owners, np.empty(room, np.int64)))
        begin = count
        for k in range(first if alike < last else last, last):  # not all name the same entry
            entry = indices[rows[k]]
            if pair_of[entry] < begin:  # not named by this part so far
                entries[count], owners[count], pair_of[entry] = entry, part, count
                count += 1
        if alike == last and first < last:
            entries[count], owners[count] = indices[rows[first]], part
            count += 1
            continue
        entries[begin:count].sort()
        for pair in range(begin, count):
            pair_of[entries[pair]] = pair
        for k in range(first, last):
            place[k] = pair_of[indices[rows[k]]]
    return entries[:count].copy(), owners[:count].copy(), place


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _number_leading_alike(indices, rows, first, last, place, number):
    """Number the rows from the first on as long as they name the entry that it names; where that ends."""
    k = first
    while k < last and indices[np.uint64(rows[k])] == indices[np.uint64(rows[first])]:
        place[k] = number
        k += np.uint64(1)
    return k
