"""The ground takes back what lies on it: segmenters put the shadow of a car into its mask."""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Bool, Float32, Int64, UInt16
from numpy import ndarray
from scipy.spatial import KDTree

from instdrive_core.training.instances.ground_height import ON_GROUND, find_ground_groups

FLAT = 0.05
"""Metres above the ground that a Gaussian reaches at most, by its standard deviation, to lie flat on it."""
LOW, BODY, BESIDE = 0.2, 0.3, 0.4
"""Metres above the ground: what is lower than the first, and in plan farther than the last from all of the same thing
that is higher than the second, is no part of that thing, however thick it is."""
HOP = 1.5
"""Metres from ground to what it takes, which is ground from then on: so it spreads over shadows of any size."""
UPWARDS = 30.0
"""A metre upwards counts as so many along the ground: a kerb stops the ground, a slope does not."""


def claim_flat(
    groups: Int64[ndarray, " n"],
    weights: Float32[ndarray, " n"],
    nodes: UInt16[ndarray, " n"],
    means: Float32[ndarray, "n 3"],
    thicknesses: Float32[ndarray, " n"],
    heights: Float32[ndarray, " n"],
) -> Int64[ndarray, " n"]:
    """Give what lies on the ground, but belongs to no ground, to the group of the ground around it: what is flat, and
    what is low and far from all that stands of its thing.

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
    fresh = np.flatnonzero(on_ground & (heights <= ON_GROUND))
    lying = (heights + thicknesses <= FLAT) | _find_astray(groups, counts, means, heights)
    free = np.flatnonzero(counts & ~on_ground & lying)
    surface = means[:, 2] - np.minimum(heights, 0)  # what lies below the ground looks as if it lay on it
    places, claimed = np.column_stack([means[:, :2], UPWARDS * surface]), groups.copy()
    while len(fresh) and len(free):
        tree, threads = KDTree(places[fresh]), numba.get_num_threads()
        distances, nearest = tree.query(places[free], distance_upper_bound=HOP, workers=threads)
        found = np.isfinite(distances)
        claimed[free[found]] = claimed[fresh[np.asarray(nearest)[found]]]
        fresh, free = free[found], free[~found]
    return claimed


def _find_astray(
    groups: Int64[ndarray, " n"],
    counts: Bool[ndarray, " n"],
    means: Float32[ndarray, "n 3"],
    heights: Float32[ndarray, " n"],
) -> Bool[ndarray, " n"]:
    """Find what is low beside all that stands of its thing; low things of which nothing stands have nothing astray."""
    body, low = np.flatnonzero(counts & (heights > BODY)), np.flatnonzero(counts & (heights <= LOW))
    low = low[np.isin(groups[low], groups[body])]
    astray = np.zeros(len(groups), bool)
    if len(low):
        # Groups lie so far apart along the third axis that none is near another one.
        places = np.column_stack([means[:, :2], groups * (2.0 * BESIDE)])
        distances, _ = KDTree(places[body]).query(
            places[low], distance_upper_bound=BESIDE, workers=numba.get_num_threads()
        )
        astray[low] = np.isinf(distances)
    return astray
