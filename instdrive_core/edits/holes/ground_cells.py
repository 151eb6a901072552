"""Sets of cells of a ground grid: growing them, keeping large parts, finding those under objects."""

from __future__ import annotations

from collections.abc import Sequence

import numba
import numpy as np
from jaxtyping import Bool, Float64
from numpy import ndarray
from scipy import ndimage

from instdrive_core.edits.holes.ground_grid import GroundGrid
from instdrive_core.edits.holes.surroundings import StandingObject


def find_covered_cells(standing: Sequence[StandingObject], grid: GroundGrid) -> Bool[ndarray, "a b"]:
    """Mask of the cells under any object that does not move."""
    under = np.zeros(grid.shape, bool).ravel()
    places = grid.compute_centers(grid.list_cells())
    for each in standing:
        if each.track is None:
            near = np.flatnonzero((np.abs(places - each.body.center[:2]) <= each.body.reach).all(axis=1))
            under[near] |= _is_under(each, places[near])
    return under.reshape(grid.shape)


def grow_cells(cells: Bool[ndarray, "a b"], size: float, metres: float) -> Bool[ndarray, "a b"]:
    """Add all cells (of `size` metres) that are at most some metres away."""
    return _compute_distances(~cells) * size <= metres if cells.any() else cells


def find_nearer_cells(cells: Bool[ndarray, "a b"], others: Bool[ndarray, "a b"]) -> Bool[ndarray, "a b"]:
    """Find all cells that are nearer to some cells than to others; none where there are none of either."""
    if not cells.any() or not others.any():
        return np.zeros_like(cells)
    return _compute_distances(~cells) < _compute_distances(~others)


def _compute_distances(free: Bool[ndarray, "a b"]) -> Float64[ndarray, "a b"]:
    """Cells from each free one to the nearest that is not."""
    return np.asarray(ndimage.distance_transform_edt(free), np.float64)


def keep_large_parts(cells: Bool[ndarray, "a b"], size: float, area: float) -> Bool[ndarray, "a b"]:
    """Keep the connected parts of at least `area` square metres; cells are `size` metres long."""
    parts = np.zeros(cells.shape, np.int32)
    ndimage.label(cells, np.ones((3, 3)), parts)
    return cells & (np.bincount(parts.ravel())[parts] * size**2 >= area)


def _is_under(each: StandingObject, places: Float64[ndarray, "c 2"]) -> Bool[ndarray, " c"]:
    """Whether any point above each place is in the body's hull."""
    body = each.body
    level = (np.c_[places, np.full(len(places), body.center[2])] - body.center) @ body.axes
    return _meet_verticals(level, body.planes)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _meet_verticals(places: Float64[ndarray, "c 3"], planes: Float64[ndarray, "k 4"]) -> Bool[ndarray, " c"]:
    """Whether the vertical lines through places meet a hull: its faces clip them from both ends."""
    met = np.zeros(len(places), np.bool_)
    for place in range(len(places)):
        lower, upper = -np.inf, np.inf
        for k in range(len(planes)):
            start, slope = planes[k, 3], planes[k, 2]
            for axis in range(3):
                start += planes[k, axis] * places[place, axis]
            if slope > 1e-9:
                upper = min(upper, -start / slope)
            elif slope < -1e-9:
                lower = max(lower, -start / slope)
            elif start > 0:
                upper = -np.inf
            if lower >= upper:
                break
        met[place] = lower < upper
    return met
