"""Writing to many rows of an array in one walk each, which also finds the bounds of what was written."""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True, nogil=True, error_model="numpy")
def exchange_values(numbers, rows, values):
    """Write values into rows, in place; returns what the rows held before, and their bounds.

    No row may be named twice. Raises IndexError, with nothing written, for a row that is not there.
    """
    low, high = _find_bounds(rows, len(numbers))
    if len(rows) != len(values):
        raise IndexError("there are not as many values as rows")
    before = np.empty(len(rows), numbers.dtype)
    for k in range(len(rows)):
        before[k] = numbers[rows[k]]
        numbers[rows[k]] = values[k]
    return before, low, high


@numba.njit(cache=True, nogil=True, error_model="numpy")
def change_bits(flags, rows, bits, on):
    """Set or clear all of `bits`, in place; returns the rows where that changed anything, and their bounds.

    Raises IndexError, with nothing written, for a row that is not there.
    """
    _find_bounds(rows, len(flags))
    changed, count, low, high = np.empty(len(rows), np.int64), 0, np.int64(len(flags)), np.int64(0)
    for row in rows:
        if ((flags[row] & bits) == bits) != on:
            flags[row] = flags[row] | bits if on else flags[row] & ~bits
            changed[count] = row
            count, low, high = count + 1, min(low, row), max(high, row + 1)
    return changed[:count].copy(), low, high


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _find_bounds(rows, length):
    """The lowest row and one more than the highest: compiled code would write anywhere."""
    low, high = np.int64(length), np.int64(0)
    for row in rows:
        low, high = min(low, np.int64(row)), max(high, np.int64(row) + 1)
    if len(rows) and (low < 0 or high > length):
        raise IndexError("a row is not there")
    return low, high
