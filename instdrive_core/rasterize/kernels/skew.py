"""Splats put where a camera sees them whose lines are exposed one after the other."""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float32, Float64, UInt16
from numpy import ndarray

_NEAR = 0.05
"""Metres in front of the camera from which splats are put elsewhere."""
_BEYOND = 0.75
"""Farthest that a line may be from the picture's middle, in pictures: half a picture is its edge."""
_ROUNDS = 4
"""Times that a splat's line is looked up again where it has been put."""


@numba.njit(cache=True, parallel=True, error_model="numpy")
def skew_means(
    means: Float32[ndarray, "n 3"],
    nodes: UInt16[ndarray, " n"],
    camera_from_node: Float64[ndarray, "3 m 4 4"],
    node_from_camera: Float64[ndarray, "m 4 4"],
    lens: tuple[float, float, int],
    backwards: bool,
    skewed: Float32[ndarray, "n 3"],
) -> None:
    """Write where splats stand, in their nodes, at the moment of the line that they fall on.

    Args:
        means: in their nodes' frames.
        nodes: node of each row.
        camera_from_node: at the start, the middle and the end of the picture; between them positions are quadratic.
        node_from_camera: at the middle.
        lens: focal length and principal point across the lines, as shares of the picture's size, and which axis that
            is, 0 or 1.
        backwards: whether the last line is exposed first.
        skewed: written. Splats behind the camera and those that are not finite stay where they are.
    """
    focal, center, axis = lens
    for i in numba.prange(len(means)):
        x, y, z, node = means[i, 0], means[i, 1], means[i, 2], nodes[i]
        first, linear, square = np.empty(3), np.empty(3), np.empty(3)
        nearest = np.inf
        for k in range(3):
            at = np.empty(3)
            for moment in range(3):
                row = camera_from_node[moment, node, k]
                at[moment] = row[0] * x + row[1] * y + row[2] * z + row[3]
            first[k], linear[k], square[k] = at[1], at[2] - at[0], 2 * (at[0] + at[2] - 2 * at[1])
            if k == 2:
                nearest = min(at[0], at[1], at[2])
        skewed[i] = means[i]
        if not nearest > _NEAR or not np.isfinite(first[0] + first[1]):
            continue
        late = 0.0
        for _ in range(_ROUNDS):
            across = first[axis] + late * linear[axis] + late * late * square[axis]
            depth = max(first[2] + late * linear[2] + late * late * square[2], _NEAR)
            late = focal * across / depth + center - 0.5
            if backwards:
                late = -late
            late = min(max(late, -_BEYOND), _BEYOND)
        for k in range(3):
            first[k] += late * linear[k] + late * late * square[k]
        for k in range(3):
            row = node_from_camera[node, k]
            skewed[i, k] = row[0] * first[0] + row[1] * first[1] + row[2] * first[2] + row[3]
