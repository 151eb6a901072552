"""How high the carriageway lies on and under the ground around a place, and so how high kerbs and pavements rise."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray

from instdrive_core.edits.holes.ground_map import GroundMap
from instdrive_core.edits.holes.inpainting import profile_lines, sum_lines

REACH = 4.0
"""Metres along the lane over which known heights count less by e for how high the ground on a line is."""
LEAST_TOLD = 0.3
"""Cells right there that known ground on a line must count like, to say how high the line is."""
STEP = 0.04
"""Metres by which the next line of a carriageway differs at most: no kerb is so low, and no camber so steep."""
FOLLOWED = 0.3
"""Share of that difference by which the level goes along: noise of one line is none of the next."""
LOWEST_SHARE = 0.2
"""Share of what is known that is carriageway at least."""


def profile_ground(
    ground: GroundMap, known: Bool[ndarray, "a b"], lowest: Bool[ndarray, " b"] | None = None
) -> Float64[ndarray, "a b"]:
    """How high (metres) the ground is that belongs to each cell, as far as `known` cells on its line along the lane
    tell; see `profile_lines`."""
    return profile_lines(ground.height, known, REACH / ground.grid.size, lowest)


def measure_rise(
    ground: GroundMap, known: Bool[ndarray, "a b"], lowest: Bool[ndarray, " b"] | None = None
) -> Float64[ndarray, "a b"]:
    """How many metres the ground that belongs to each cell lies above the carriageway, as far as `known` cells tell.

    That is asked of whole lines along the lane: single cells are as uneven as kerbs are high.
    """
    return profile_ground(ground, known, lowest) - follow_carriageway(ground.height, known, ground.grid.size)


def follow_carriageway(
    height: Float64[ndarray, "a b"], known: Bool[ndarray, "a b"], size: float
) -> Float64[ndarray, "a b"]:
    """The height (metres) of the carriageway on each cell, and below each cell that lies above it.

    It is followed from line to line across the lane for as long as the ground goes on without a step; what lies beyond
    a step, and lines on which nothing is known, have the level before. 0 where nothing is known at all.

    Args:
        height: of the cells, which lie along the lane on axis 0, metres.
        size: metres of a cell.
    """
    if not known.any():
        return np.zeros(height.shape)
    sums, total = sum_lines(height, known, REACH / size)
    lines, told = sums / np.maximum(total, 1e-9), total >= LEAST_TOLD
    start = _choose_start(np.where(known, height, 0).sum(axis=0), known.sum(axis=0))
    column = height[known[:, start], start].mean()
    first = np.where(told[:, start], lines[:, start], column)
    levels = np.empty(height.shape)
    for numbers in (range(start, -1, -1), range(start, height.shape[1])):
        level = first
        for number in numbers:
            away = lines[:, number] - level
            level = level + FOLLOWED * np.where(told[:, number] & (np.abs(away) <= STEP), away, 0)
            levels[:, number] = level
    return levels


def _choose_start(sums: Float64[ndarray, " b"], counts: Int64[ndarray, " b"]) -> int:
    """The line of which most is known among those that are about as low as the lowest `LOWEST_SHARE` of the ground."""
    means = np.where(counts > 0, sums / np.maximum(counts, 1), np.inf)
    order = np.argsort(means, kind="stable")
    low = means[order[np.searchsorted(np.cumsum(counts[order]), LOWEST_SHARE * counts.sum())]]
    return int(np.where(means <= low + STEP, counts, -1).argmax())
