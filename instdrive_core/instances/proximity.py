"""Which of many points lie near others, in time proportional to those that can."""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float, Float32, Int64
from numpy import ndarray

from instdrive_core.instances.neighbors import build_forest

_RING = 6
"""Neighbours of a point in an even covering of a surface."""
_SAMPLE = 30_000
"""Points among which neighbours are looked for."""
_ASKED = 1_000
"""Points whose neighbours are looked for."""


def find_rows_near(
    points: Float32[ndarray, "n 3"], asked: Int64[ndarray, " a"], others: Int64[ndarray, " b"], distance: float
) -> Int64[ndarray, " k"]:
    """Find those of the rows `asked` whose point is at most `distance` from the point of any of the rows `others`.

    Points that are not finite are near nothing.
    """
    # Only what lies in both sets' bounds can be near the other: one car of a million splats is a small problem.
    asked = _select_in_box(points, asked, *_compute_reach(points, others, distance))
    others = _select_in_box(points, others, *_compute_reach(points, asked, distance))
    if not len(asked) or not len(others):
        return np.zeros(0, np.int64)
    forest = build_forest(points[others], np.zeros(len(others), np.int64))
    reach = np.full(len(asked), float(distance))
    distances, _ = forest.find_nearest(points[asked], np.zeros(len(asked), np.int64), 1, reach)
    return asked[np.isfinite(distances[:, 0])]


def estimate_spacing(points: Float32[ndarray, "n 3"]) -> float:
    """Estimate how far points that cover surfaces lie apart: the median distance to the last of the six around one.

    Of many points some are looked at: every m-th ones lie √m times as far apart on a surface. Not finite points are
    left out; inf where fewer than seven points remain.
    """
    points = points[np.isfinite(points).all(axis=1)]
    step = -(-len(points) // _SAMPLE) if len(points) else 1
    sample = points[::step]
    if len(sample) <= _RING:
        return np.inf
    forest = build_forest(sample, np.zeros(len(sample), np.int64))
    queries = sample[:: -(-len(sample) // _ASKED)]
    reach = np.full(len(queries), np.inf)
    distances, _ = forest.find_nearest(queries, np.zeros(len(queries), np.int64), _RING + 1, reach)
    return float(np.median(distances[:, _RING]) / np.sqrt(step))


def _compute_reach(points: ndarray, rows: ndarray, distance: float) -> tuple[ndarray, ndarray]:
    low, high = _compute_bounds(points, rows)
    return low - distance, high + distance


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _compute_bounds(
    points: Float32[ndarray, "n 3"], rows: Int64[ndarray, " m"]
) -> tuple[Float[ndarray, "3"], Float[ndarray, "3"]]:
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for row in rows:
        x, y, z = points[row, 0], points[row, 1], points[row, 2]
        if np.isfinite(x + y + z):
            low[0], high[0] = min(low[0], x), max(high[0], x)
            low[1], high[1] = min(low[1], y), max(high[1], y)
            low[2], high[2] = min(low[2], z), max(high[2], z)
    return low, high


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _select_in_box(
    points: Float32[ndarray, "n 3"], rows: Int64[ndarray, " m"], low: Float[ndarray, "3"], high: Float[ndarray, "3"]
) -> Int64[ndarray, " k"]:
    inside, count = np.empty(len(rows), np.int64), 0
    for row in rows:
        within = low[0] <= points[row, 0] <= high[0] and low[1] <= points[row, 1] <= high[1]
        if within and low[2] <= points[row, 2] <= high[2]:
            inside[count] = row
            count += 1
    return inside[:count].copy()
