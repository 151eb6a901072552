"""Bounds of many instances in one walk over their rows."""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float32, Int64
from numpy import ndarray

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.row_parts import RowParts

SHARES = (0.03, 0.97)
"""Between which quantiles of its means an instance lies; as of `instances.table.compute_middle_bounds`."""
_FEW = 32
"""Values beyond a rank that are cheaper kept in order than partitioned."""


def compute_part_bounds(document: Document, parts: RowParts) -> Float32[ndarray, "p 2 3"]:
    """`compute_middle_bounds` of each part's present means, metres, in the rows' nodes; each has at least one row."""
    palette, last = document.transforms, parts.sizes - 1
    # As "nearest" of np.quantile: halves go to the even one.
    ranks = np.stack([np.rint(last * share) for share in SHARES], axis=1).astype(np.int64)
    means = np.ascontiguousarray(document.scene.gaussians.means)
    return _compute_bounds(means, palette.indices, np.array(palette.matrices), parts.rows, parts.bounds, ranks)


def find_main_nodes_of_parts(document: Document, parts: RowParts) -> Int64[ndarray, " p"]:
    """The node that most rows of each part, which has at least one, belong to; the lowest of equals."""
    main = np.zeros(len(parts), np.int64)
    if not document.scene.actors:
        return main
    nodes = document.scene.nodes[parts.rows]
    for part in np.unique(np.searchsorted(parts.bounds, np.flatnonzero(nodes), side="right") - 1).tolist():
        main[part] = np.bincount(nodes[parts.bounds[part] : parts.bounds[part + 1]]).argmax()
    return main


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def _compute_bounds(means, entries, matrices, rows, bounds, ranks):
    found = np.empty((len(bounds) - 1, 2, 3), np.float32)
    for part in numba.prange(len(found)):
        first, count = bounds[part], bounds[part + 1] - bounds[part]
        values = np.empty((3, count), np.float32)
        for k in range(count):
            row = rows[first + k]
            entry = entries[row]
            x, y, z = means[row, 0], means[row, 1], means[row, 2]
            for axis in range(3):
                value = means[row, axis]
                if entry:
                    m = matrices[entry, axis]
                    value = np.float32(m[0] * x + m[1] * y + m[2] * z + m[3])
                values[axis, k] = value
        for axis in range(3):
            found[part, 0, axis], found[part, 1, axis] = _find_ends(values[axis], ranks[part, 0], ranks[part, 1])
    return found


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _find_ends(values, low, high):
    """The values of two ranks; NaN where any value is. Close to the ends, one walk that keeps the few beyond them."""
    below, above = low + 1, len(values) - high
    total = np.float32(0)
    for value in values:
        total += value - value
    if np.isnan(total):  # not finite: infinities are ranked, NaN has no rank
        for value in values:
            if np.isnan(value):
                return np.float32(np.nan), np.float32(np.nan)
    if max(below, above) > _FEW:
        return _select_rank(values, low), _select_rank(values, high)
    smallest, largest = np.full(below, np.float32(np.inf)), np.full(above, np.float32(-np.inf))
    for value in values:
        if value < smallest[below - 1]:
            k = below - 1
            while k > 0 and smallest[k - 1] > value:
                smallest[k] = smallest[k - 1]
                k -= 1
            smallest[k] = value
        if value > largest[above - 1]:
            k = above - 1
            while k > 0 and largest[k - 1] < value:
                largest[k] = largest[k - 1]
                k -= 1
            largest[k] = value
    return smallest[below - 1], largest[above - 1]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _select_rank(values, rank):
    """The value of a rank, by Hoare's selection: what is smaller comes before it, what is larger after it."""
    low, high = 0, len(values) - 1
    while low < high:
        middle = values[(low + high) // 2]
        left, right = low, high
        while left <= right:
            while values[left] < middle:
                left += 1
            while values[right] > middle:
                right -= 1
            if left <= right:
                values[left], values[right] = values[right], values[left]
                left, right = left + 1, right - 1
        if rank <= right:
            high = right
        elif rank >= left:
            low = left
        else:
            break
    return values[rank]
