"""Writing numbers of many rows, and what was there before, in one walk."""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True, nogil=True, error_model="numpy")
def exchanged(numbers, rows, values):
    """Write values, in place; returns what rows held before, and the bounds of the rows.

    No row may be named twice. Raises IndexError, with nothing written, for a row that is not there.
    """
    low, high = np.int64(len(numbers)), np.int64(0)
    for row in rows:
        low, high = min(low, row), max(high, row + 1)
    if len(rows) != len(values) or (len(rows) and (low < 0 or high > len(numbers))):
        raise IndexError("rows and values do not fit the array")
    before = np.empty(len(rows), numbers.dtype)
    for k in range(len(rows)):
        before[k] = numbers[rows[k]]
        numbers[rows[k]] = values[k]
    return before, low, high
