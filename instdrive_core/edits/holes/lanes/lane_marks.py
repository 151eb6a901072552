"""Marks on the road that run along the lane, as the ground shows them from above."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray
from numpy.lib.stride_tricks import sliding_window_view

from instdrive_core.edits.holes.inpainting import weigh_along

HALF_WINDOW = 0.8
"""Metres across the lane on either side that a mark is brighter than: twice as wide as the widest one."""
BRIGHTER = 1.2
"""Times that it is brighter at least."""
LEAST_SHARE = 0.4
"""Share of what is known near on its line that a mark must be to go on: dashes are not."""
REACH = 2.0
"""Metres along the lane over which what is known counts less by e."""
SAME_LEVEL = 0.06
"""Metres of height up to which it lies on what it is compared with: the edge of a pavement does not."""


def find_lane_marks(
    brightness: Float64[ndarray, "a b"], height: Float64[ndarray, "a b"], known: Bool[ndarray, "a b"], size: float
) -> Bool[ndarray, "a b"]:
    """Find the cells, `size` metres wide, that are brighter than most of what is `known` on either side of them across
    the lane. `height` is in metres."""
    reach = round(HALF_WINDOW / size)
    usual, level = (_find_medians(np.where(known, values, np.nan), reach) for values in (brightness, height))
    return known & (brightness > BRIGHTER * usual) & (np.abs(height - level) <= SAME_LEVEL)


def continue_marks(
    sources: Int64[ndarray, "a b 2"],
    marks: Bool[ndarray, "a b"],
    known: Bool[ndarray, "a b"],
    hole: Bool[ndarray, "a b"],
    size: float,
) -> Int64[ndarray, "a b 2"]:
    """Let lines go on through a hole: its cells on a line are those before or behind it on the same line, mirrored.

    Args:
        sources: the cell that is copied to each cell of the hole, -1 elsewhere.
        marks: those of `find_lane_marks`.
        size: metres of a cell.
    """
    weights = weigh_along(len(hole), REACH / size)
    goes_on = hole & (weights @ (marks & known) >= LEAST_SHARE * np.maximum(weights @ known, 1))
    result = sources.copy()
    for column in np.flatnonzero(goes_on.any(axis=0)):
        there, cells = np.flatnonzero(known[:, column]), np.flatnonzero(goes_on[:, column])
        after = np.searchsorted(there, cells)
        before, behind = there[np.clip([after - 1, after], 0, len(there) - 1)]
        is_nearer = np.abs(before - cells) <= np.abs(behind - cells)
        for edge in (np.where(is_nearer, behind, before), np.where(is_nearer, before, behind)):  # the nearer one wins
            mirrored = 2 * edge - cells
            fits = (mirrored >= 0) & (mirrored < len(hole))
            fits[fits] = known[mirrored[fits], column]
            result[cells[fits], column, 0], result[cells[fits], column, 1] = mirrored[fits], column
    return result


def _find_medians(values: Float64[ndarray, "a b"], reach: int) -> Float64[ndarray, "a b"]:
    """Median of what is known within `reach` cells along axis 1, infinite where nothing is."""
    padded = np.pad(values, ((0, 0), (reach, reach)), constant_values=np.nan)
    windows = np.sort(sliding_window_view(padded, 2 * reach + 1, axis=1), axis=2)  # NaN comes last
    counts = np.isfinite(windows).sum(axis=2)
    medians = np.take_along_axis(windows, np.maximum(counts - 1, 0)[..., None] // 2, axis=2)[..., 0]
    return np.where(counts > 0, medians, np.inf)
