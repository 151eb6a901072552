"""Finding which of many boxes a point lies in."""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float32, Float64, Int32
from numpy import ndarray


def find_box_of_points(
    points: Float32[ndarray, "n 3"],
    world_from_boxes: Float64[ndarray, "b 4 4"],
    dimensions: Float64[ndarray, "b 3"],
    margin: float = 0.0,
    bottom: float | None = None,
) -> Int32[ndarray, " n"]:
    """Find the number of the last box that holds each point, -1 where none does.

    Boxes are grown as by `scene.track.find_points_inside`: by `margin` metres, at the lower face by `bottom` if given.
    The interpreter's lock is released while it searches.
    """
    half = np.asarray(dimensions, np.float64).reshape(-1, 3) / 2
    lower, upper = -half - margin, half + margin
    if bottom is not None:
        lower[:, 2] = -half[:, 2] - bottom
    poses = np.asarray(world_from_boxes, np.float64).reshape(-1, 4, 4)
    reach = np.linalg.norm(np.maximum(np.abs(lower), np.abs(upper)), axis=1)
    return _find_last_box(np.ascontiguousarray(points, np.float32), np.ascontiguousarray(poses), lower, upper, reach)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _find_last_box(
    points: Float32[ndarray, "n 3"],
    poses: Float64[ndarray, "b 4 4"],
    lower: Float64[ndarray, "b 3"],
    upper: Float64[ndarray, "b 3"],
    reach: Float64[ndarray, " b"],
) -> Int32[ndarray, " n"]:
    found = np.full(len(points), -1, np.int32)
    for i in range(len(points)):
        for b in range(len(poses) - 1, -1, -1):
            x = points[i, 0] - poses[b, 0, 3]
            y = points[i, 1] - poses[b, 1, 3]
            if abs(x) > reach[b] or abs(y) > reach[b]:  # most boxes are far away: a cheap test first
                continue
            z = points[i, 2] - poses[b, 2, 3]
            inside = True
            for axis in range(3):
                local = x * poses[b, 0, axis] + y * poses[b, 1, axis] + z * poses[b, 2, axis]
                inside &= lower[b, axis] <= local <= upper[b, axis]
            if inside:
                found[i] = b
                break
    return found
