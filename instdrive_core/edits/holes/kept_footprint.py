"""Ground under what was kept of things that were deleted in part: it still stands there, so nothing is uncovered."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float64
from numpy import ndarray
from scipy import ndimage
from scipy.spatial import ConvexHull, QhullError

from instdrive_core.edits.holes.ground_cells import grow_cells
from instdrive_core.edits.holes.ground_grid import GroundGrid
from instdrive_core.edits.queries.placement import estimate_foot

MAX_FOOT = 0.4
"""Metres above the ground that the lowest splats of what stands on it may be …"""
LOW = 1.0
"""… and below which splats say where it stands: the ground under a roof alone is not covered."""
MAX_GAP = 0.6
"""Metres: splats farther apart, seen from above, belong to pieces of their own."""


def find_kept_footprint(kept: Sequence[Float64[ndarray, "_ 3"]], grid: GroundGrid) -> Bool[ndarray, "a b"]:
    """Cells inside the outlines of the pieces that reach the ground; `kept` are points of one thing each, metres."""
    under = np.zeros(grid.shape, bool)
    for points in kept:
        low = points[grid.compute_heights(points) <= LOW]
        for piece in _split_pieces(low[grid.contains(grid.find_cells(low))], grid):
            if estimate_foot(grid.compute_heights(piece)) <= MAX_FOOT:
                under |= _find_inside_outline(piece, grid)
    return under


def _split_pieces(points: Float64[ndarray, "k 3"], grid: GroundGrid) -> list[Float64[ndarray, "m 3"]]:
    """Points that hang together, seen from above."""
    cells = grid.find_cells(points)
    numbers = np.zeros(grid.shape, np.int32)
    ndimage.label(grow_cells(grid.count_cells(cells) > 0, grid.size, MAX_GAP / 2), np.ones((3, 3)), numbers)
    mine = numbers[tuple(cells.T)]
    return [points[mine == number] for number in np.unique(mine)]


def _find_inside_outline(points: Float64[ndarray, "k 3"], grid: GroundGrid) -> Bool[ndarray, "a b"]:
    """Cells whose middle is at most half a cell outside of the convex outline."""
    try:
        edges = ConvexHull(points[:, :2]).equations
    except (QhullError, ValueError):
        return grid.count_cells(grid.find_cells(points)) > 0
    beyond = grid.compute_centers(grid.list_cells()) @ edges[:, :2].T + edges[:, 2]
    return (beyond.max(axis=1) <= grid.size / 2).reshape(grid.shape)
