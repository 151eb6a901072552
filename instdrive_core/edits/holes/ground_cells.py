"""Sets of cells of a ground grid: growing them, keeping large parts, finding those under objects."""

from __future__ import annotations

from collections.abc import Sequence

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


def _compute_distances(free: Bool[ndarray, "a b"]) -> Float64[ndarray, "a b"]:
    """Cells from each free one to the nearest that is not."""
    return np.asarray(ndimage.distance_transform_edt(free), np.float64)


def keep_large_parts(cells: Bool[ndarray, "a b"], size: float, area: float) -> Bool[ndarray, "a b"]:
    """Keep the connected parts of at least `area` square metres; cells are `size` metres long."""
    parts = np.zeros(cells.shape, np.int32)
    ndimage.label(cells, np.ones((3, 3)), parts)
    return cells & (np.bincount(parts.ravel())[parts] * size**2 >= area)


def _is_under(each: StandingObject, places: Float64[ndarray, "c 2"]) -> Bool[ndarray, " c"]:
    """Whether any point above each place is in the body's hull: its faces clip the vertical line from both ends."""
    body = each.body
    level = (np.c_[places, np.full(len(places), body.center[2])] - body.center) @ body.axes
    starts = level @ body.planes[:, :3].T + body.planes[:, 3]
    slopes = np.broadcast_to(body.planes[:, 2], starts.shape)
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = -starts / slopes
    upper = np.where(slopes > 1e-9, ends, np.inf).min(axis=1)
    lower = np.where(slopes < -1e-9, ends, -np.inf).max(axis=1)
    beside = ((np.abs(slopes) <= 1e-9) & (starts > 0)).any(axis=1)
    return (lower < upper) & ~beside
