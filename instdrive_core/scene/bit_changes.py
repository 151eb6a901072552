"""Setting and clearing bits of many rows in one walk."""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True, nogil=True, error_model="numpy")
def change_bits(flags, rows, bits, on):
    """Set or clear all of `bits`, in place; returns the rows where that changed anything, and their bounds."""
    changed, count, low, high = np.empty(len(rows), np.int64), 0, np.int64(len(flags)), np.int64(0)
    for row in rows:
        if ((flags[row] & bits) == bits) != on:
            flags[row] = flags[row] | bits if on else flags[row] & ~bits
            changed[count] = row
            count, low, high = count + 1, min(low, row), max(high, row + 1)
    return changed[:count].copy(), low, high
