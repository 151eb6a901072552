"""The ground takes back what lies flat on it: segmenters put the shadow of a car into its mask."""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float32, Int64, UInt16
from numpy import ndarray
from scipy.spatial import KDTree

from instdrive_core.training.instances.ground_height import ON_GROUND, find_ground_groups

FLAT = 0.05
"""Metres above the ground that a Gaussian reaches at most, by its standard deviation, to lie flat on it."""
REACH = 5.0
"""Metres of what is flat from the ground that takes it: as far as shadows fall from a wall of cars."""
UPWARDS = 30.0
"""What is a metre higher is as far away as this many metres along the ground: a kerb parts two grounds."""


def claim_flat(
    groups: Int64[ndarray, " n"],
    weights: Float32[ndarray, " n"],
    nodes: UInt16[ndarray, " n"],
    means: Float32[ndarray, "n 3"],
    thicknesses: Float32[ndarray, " n"],
    heights: Float32[ndarray, " n"],
) -> Int64[ndarray, " n"]:
    """Give what lies flat on the ground, but belongs to no ground, to the nearest group that is ground.

    Args:
        groups: of each Gaussian; -1 = none, these stay in none.
        weights: how much of the photos each shows; 0 = it has no say and stays.
        nodes: 0 = it stands still; others stay as they are.
        means: metres.
        thicknesses: standard deviation along z, metres.
        heights: metres above the ground (`measure_heights`).
    """
    is_ground = find_ground_groups(groups, weights, nodes, heights)
    if not is_ground.any():
        return groups
    counts = (groups >= 0) & (weights > 0) & (nodes == 0)
    on_ground = counts & is_ground[groups]
    givers = np.flatnonzero(on_ground & (heights <= ON_GROUND))
    takers = np.flatnonzero(counts & ~on_ground & (heights + thicknesses <= FLAT))
    if not len(givers) or not len(takers):
        return groups
    scale = np.array([1, 1, UPWARDS], np.float32)
    tree, threads = KDTree(means[givers] * scale), numba.get_num_threads()
    distances, nearest = tree.query(means[takers] * scale, distance_upper_bound=REACH, workers=threads)
    found = np.isfinite(distances)
    claimed = groups.copy()
    claimed[takers[found]] = groups[givers[np.asarray(nearest)[found]]]
    return claimed
