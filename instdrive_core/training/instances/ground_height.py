"""How high Gaussians lie above the ground that LiDAR saw.

The surface that tells LiDAR's own points from the ground (`masks.lidar.ground`) is smooth across kerbs, and guessed
where nothing was seen. Here kerbs matter, and what is not known is said.
"""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Bool, Float32, Int64, UInt16
from numpy import ndarray
from scipy.spatial import KDTree

NEAR = 1.0
"""Metres along the ground from the next point of it, up to which its height is known."""
AROUND, ASKED = 0.75, 32
"""Metres around a point, and points there at most, that tell how high the ground is."""
FLOOR = 0.25
"""Share of these points that lie lower than the ground: some lie on the foot of what stands there."""
ON_GROUND = 0.2
"""Metres: what lies lower may be part of the ground, splats below it included: nothing else is down there."""
GROUND_SHARE = 0.75
"""Share of a group's weight from which on it is ground; two thirds of a car are, if its mask holds its shadow."""


def measure_heights(means: Float32[ndarray, "n 3"], ground: Float32[ndarray, "p 3"]) -> Float32[ndarray, " n"]:
    """Measure how many metres each point lies above the ground (below: less than 0); infinite where it is not known.

    Args:
        means: metres; z is up.
        ground: LiDAR points of the ground.
    """
    if not len(ground) or not len(means):
        return np.full(len(means), np.inf, np.float32)
    tree, threads = KDTree(ground[:, :2]), numba.get_num_threads()
    asked = min(ASKED, len(ground))
    _, around = tree.query(ground[:, :2], asked, distance_upper_bound=AROUND, workers=threads)
    padded = np.append(ground[:, 2], np.float32(np.inf))
    near = np.sort(padded[np.asarray(around).reshape(len(ground), asked)], axis=1)
    lowest = np.floor(FLOOR * (np.isfinite(near).sum(axis=1) - 1)).astype(np.int64)
    floor = near[np.arange(len(near)), lowest]
    distances, nearest = tree.query(means[:, :2], distance_upper_bound=NEAR, workers=threads)
    known = np.isfinite(distances)
    heights = np.full(len(means), np.inf, np.float32)
    heights[known] = means[known, 2] - floor[np.asarray(nearest)[known]]
    return heights


def find_ground_groups(
    groups: Int64[ndarray, " n"],
    weights: Float32[ndarray, " n"],
    nodes: UInt16[ndarray, " n"],
    heights: Float32[ndarray, " n"],
) -> Bool[ndarray, " g"]:
    """Find the groups of which nearly all lies on the ground and stands still; -1 is no group."""
    named = groups >= 0
    count = int(groups.max(initial=-1)) + 1
    low = named & (nodes == 0) & (heights <= ON_GROUND)
    totals = np.bincount(groups[named], weights[named], count)
    return np.bincount(groups[low], weights[low], count) > GROUND_SHARE * totals
