"""The plane of the carriageway around a place, in the presence of kerbs, pavements and floaters."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Float64
from numpy import ndarray

DRAWS = 300
MAX_POINTS = 4000
MIN_POINTS = 20
TOLERANCE = 0.04
"""Metres from the plane at which a point no longer agrees: a third of a kerb, so that no plane between carriageway
and pavement wins."""
MAX_SLOPE = 0.25
MIN_SHARE = 0.15
"""Share of all points that must agree with a plane for it to be ground."""
BELOW_WEIGHT = 0.5
"""A point below the plane speaks against it by so much: what is above may stand on it, below it is only noise."""
_REFITS = 3
TOP_CELL, TOP_DEPTH = 0.5, 0.1
"""Metres per side of the cells whose highest points are the surface, and how far below it points belong to it."""


def fit_ground_plane(points: Float[ndarray, "n 3"]) -> Float64[ndarray, "3"] | None:
    """Height (metres) at x = y = 0 and slopes along x and y of the plane that most points agree with.

    Planes through three points, drawn by lot (RANSAC, Fischler & Bolles 1981) but always the same for the same points,
    then refitted to what agrees. None where there are too few points or too few agree. Give points near the origin:
    heights far from it are extrapolated.
    """
    rng = np.random.default_rng(0)
    if len(points) > MAX_POINTS:
        points = points[np.sort(rng.choice(len(points), MAX_POINTS, replace=False))]
    if len(points) < MIN_POINTS:
        return None
    columns = np.c_[np.ones(len(points)), points[:, :2].astype(np.float64)]
    heights = points[:, 2].astype(np.float64)
    draws = rng.integers(0, len(points), (DRAWS, 3))
    determinants = np.abs(np.linalg.det(columns[draws]))
    # Narrow triangles have a slope of noise.
    draws = draws[determinants > 0.05 * determinants.max(initial=0.0)]
    if not len(draws):
        return None
    planes = np.linalg.solve(columns[draws], heights[draws][..., None])[..., 0]
    planes = planes[np.hypot(planes[:, 1], planes[:, 2]) <= MAX_SLOPE]
    if not len(planes):
        return None
    residuals = heights - planes @ columns.T
    votes = np.maximum(1 - (residuals / TOLERANCE) ** 2, 0).sum(axis=1)
    votes -= BELOW_WEIGHT * (residuals < -TOLERANCE).sum(axis=1)
    plane = planes[int(votes.argmax())]
    for _ in range(_REFITS):
        agreeing = _find_agreeing(plane, columns, heights)
        if agreeing.sum() < max(MIN_POINTS // 2, MIN_SHARE * len(points)):
            return None
        plane = np.linalg.lstsq(columns[agreeing], heights[agreeing], rcond=None)[0]
    return plane


def keep_topmost(points: Float[ndarray, "n 3"]) -> Float[ndarray, "m 3"]:
    """Keep the points at the top, cell by cell: what photos never showed may have trained below the road."""
    cells = np.floor(points[:, :2] / TOP_CELL).astype(np.int64)
    _, cell_of = np.unique(cells, axis=0, return_inverse=True)
    cell_of = cell_of.ravel()
    tops = np.full(cell_of.max(initial=-1) + 1, -np.inf)
    np.maximum.at(tops, cell_of, points[:, 2])
    return points[points[:, 2] >= tops[cell_of] - TOP_DEPTH]


def _find_agreeing(
    plane: Float64[ndarray, "3"], columns: Float64[ndarray, "n 3"], heights: Float64[ndarray, " n"]
) -> Bool[ndarray, " n"]:
    return np.abs(heights - columns @ plane) <= TOLERANCE
