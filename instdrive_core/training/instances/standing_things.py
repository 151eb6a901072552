"""What stands on the ground is no part of it: segmenters overlook a hydrant, or put a piece of the road into the mask
of a cone."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, Int64, UInt16
from numpy import ndarray

from instdrive_core.training.instances.ground_height import find_ground_groups

LEAST_HEIGHT = 0.3
"""Metres that a thing rises above the ground at least: kerbs and grass are lower."""
FOOT = 0.05
"""Metres above the ground below which a Gaussian is ground, whatever stands next to it."""
LEAST_GAUSSIANS = 10


def part_standing_things(
    groups: Int64[ndarray, " n"],
    weights: Float32[ndarray, " n"],
    nodes: UInt16[ndarray, " n"],
    heights: Float32[ndarray, " n"],
    things: Int64[ndarray, " n"],
) -> Int64[ndarray, " n"]:
    """Give each standing thing of LiDAR a group of its own if most of it lies in groups of the ground.

    Args:
        groups: of each Gaussian; -1 = none, these stay in none.
        weights: how much of the photos each shows; 0 = it has no say and stays.
        nodes: 0 = it stands still; others stay as they are.
        heights: metres above the ground, infinite where it is not known (`measure_heights`).
        things: the thing that each Gaussian is part of, by LiDAR; -1 = none (`assign_lidar_things`).
    """
    is_ground = find_ground_groups(groups, weights, nodes, heights)
    counts = (groups >= 0) & (weights > 0) & (nodes == 0) & (heights > FOOT) & np.isfinite(heights)
    part = np.flatnonzero(counts & (things >= 0))
    lost = part[is_ground[groups[part]]]
    if not len(lost):
        return groups
    size = int(things[part].max()) + 1
    whole, in_ground = (np.bincount(things[rows], weights[rows], size) for rows in (part, lost))
    tops = np.zeros(size)
    np.maximum.at(tops, things[lost], heights[lost])
    enough = np.bincount(things[lost], minlength=size) >= LEAST_GAUSSIANS
    stands = (2 * in_ground > whole) & (tops >= LEAST_HEIGHT) & enough
    rows = lost[stands[things[lost]]]
    parted, numbers = groups.copy(), len(is_ground) + np.cumsum(stands) - 1
    parted[rows] = numbers[things[rows]]
    return parted
