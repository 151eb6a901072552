"""Where a vehicle stood there is carriageway, also where no photo tells a kerb from it."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float64
from numpy import ndarray

from instdrive_core.edits.holes.ground_grid import GroundGrid

STRAY_SHARE = 0.03
"""Share of a vehicle's points that may lie beyond either of its sides."""
LEAST_HEIGHT, MOST_HEIGHT = 0.2, 2.5
"""Metres above the ground between which a vehicle's sides are."""
LEAST_LENGTH, LEAST_WIDTH, MOST_WIDTH = 2.5, 1.2, 3.0
"""Metres along and across the lane of what stands like a vehicle that is parked along it."""
GUTTER = 0.2
"""Metres between a vehicle's side and the kerb."""


def find_parking_lines(points: Float64[ndarray, "n 3"], grid: GroundGrid) -> Bool[ndarray, " b"]:
    """Which lines of cells along the lane lie below a vehicle, whose solid splats are `points` (metres).

    None below what is no vehicle parked along the lane.
    """
    lines = np.zeros(grid.shape[1], bool)
    heights = grid.compute_heights(points)
    sides = points[(heights >= LEAST_HEIGHT) & (heights <= MOST_HEIGHT)]
    if not len(sides):
        return lines
    local = (sides[:, :2] - np.array(grid.corner)) @ grid.axes.T
    low, high = np.quantile(local, [STRAY_SHARE, 1 - STRAY_SHARE], axis=0)
    length, width = (high - low).tolist()
    if length >= LEAST_LENGTH and LEAST_WIDTH <= width <= MOST_WIDTH:
        edges = np.array([low[1] - GUTTER, high[1] + GUTTER]) / grid.size
        first, last = np.floor(edges).astype(int).tolist()
        lines[max(first, 0) : max(last + 1, 0)] = True
    return lines
