"""Compiled loops over the rows of a scene, on one thread: drawing needs the other cores."""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True, nogil=True, error_model="numpy")
def number_keys(keys):
    """Find the distinct keys, rising, and each row's place among them; the largest key must fit a table in memory."""
    highest = np.uint32(0)
    for key in keys:
        highest = max(highest, key)
    number = np.zeros(np.int64(highest) + 1, np.int32)
    for key in keys:
        number[key] = 1
    different = np.empty(number.sum() if len(keys) else 0, np.uint32)
    groups = np.empty(len(keys), np.int32)
    count = 0
    if len(keys):
        for key in range(len(number)):
            if number[key]:
                different[count] = key
                number[key] = count
                count += 1
        for row in range(len(keys)):
            groups[row] = number[keys[row]]
    return different, groups


@numba.njit(cache=True, nogil=True, error_model="numpy")
def group_rows(groups, count):
    """List rows by group, rising within each, and where the groups begin."""
    bounds = np.zeros(count + 1, np.int64)
    for group in groups:
        bounds[group + 1] += 1
    for group in range(count):
        bounds[group + 1] += bounds[group]
    free, order = bounds[:-1].copy(), np.empty(len(groups), np.int32)
    for row in range(len(groups)):
        group = groups[row]
        order[free[group]] = row
        free[group] += 1
    return order, bounds


@numba.njit(cache=True, nogil=True, error_model="numpy")
def gather_groups(order, bounds, groups):
    """List the rows of some groups (-1 = none), one after the other, and where each group begins."""
    starts = np.zeros(len(groups) + 1, np.int64)
    for k in range(len(groups)):
        group = groups[k]
        starts[k + 1] = starts[k] + (bounds[group + 1] - bounds[group] if group >= 0 else 0)
    rows = np.empty(starts[-1], np.int64)
    for k in range(len(groups)):
        begin = bounds[groups[k]] if groups[k] >= 0 else 0
        for place in range(starts[k + 1] - starts[k]):
            rows[starts[k] + place] = order[begin + place]
    return rows, starts


@numba.njit(cache=True, nogil=True, error_model="numpy")
def keep_free_rows(rows, bounds, flags, blocked):
    """Keep rows without any of the bits `blocked`; returns them and where each part begins."""
    kept, starts, count = np.empty(len(rows), np.int64), np.zeros(len(bounds), np.int64), 0
    for part in range(len(bounds) - 1):
        for place in range(bounds[part], bounds[part + 1]):
            if not flags[rows[place]] & blocked:
                kept[count] = rows[place]
                count += 1
        starts[part + 1] = count
    return kept[:count].copy(), starts


@numba.njit(cache=True, nogil=True, error_model="numpy")
def count_flags(groups, flags, count):
    """Count the rows of each group with each combination of the four lower bits: (count, 16)."""
    numbers = np.zeros((count, 16), np.int64)
    for row in range(len(groups)):
        numbers[groups[row], flags[row] & np.uint8(15)] += 1
    return numbers
