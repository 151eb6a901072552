"""How fast clusters move: the same object found again in the sweeps before and after."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float32, Float64
from numpy import ndarray
from scipy.optimize import linear_sum_assignment

MAX_SPEED = 30.0
"""Metres per second."""
MAX_GAP = 0.45
"""Seconds between sweeps up to which clusters are looked for in the other one."""
SIZE_WEIGHT = 1.5
"""Metres of displacement that a metre of difference in size is as unlikely as."""
MAX_COST = 6.0


@dataclass(frozen=True)
class MovingCluster:
    """A moving thing as one sweep saw it."""

    id: int
    points: Float32[ndarray, "k 3"]
    velocity: Float64[ndarray, "3"]
    """Metres per second."""

    @property
    def bounds(self) -> tuple[Float64[ndarray, "3"], Float64[ndarray, "3"]]:
        """Lowest and highest coordinates."""
        return self.points.min(axis=0).astype(float), self.points.max(axis=0).astype(float)


def with_velocities(by_time: dict[float, list[MovingCluster]]) -> dict[float, list[MovingCluster]]:
    """The clusters with the mean velocity from the sweep before and to the one after, 0 where neither shows them."""
    times = sorted(by_time)
    sums = {time: np.zeros((len(by_time[time]), 3)) for time in times}
    found = {time: np.zeros(len(by_time[time])) for time in times}
    for earlier, later in zip(times[:-1], times[1:], strict=True):
        gap = later - earlier
        if gap > MAX_GAP:
            continue
        for first, second, velocity in _matches(by_time[earlier], by_time[later], gap):
            sums[earlier][first] += velocity
            sums[later][second] += velocity
            found[earlier][first] += 1
            found[later][second] += 1
    return {
        time: [
            replace(one, velocity=total / max(1, count))
            for one, total, count in zip(by_time[time], sums[time], found[time], strict=True)
        ]
        for time in times
    }


def _matches(
    earlier: list[MovingCluster], later: list[MovingCluster], gap: float
) -> list[tuple[int, int, Float64[ndarray, "3"]]]:
    """Pairs of clusters that are the same object, and its velocity; heights do not change."""
    if not earlier or not later:
        return []
    lows, highs = (np.array([one.bounds[side] for one in earlier]) for side in (0, 1))
    other_lows, other_highs = (np.array([one.bounds[side] for one in later]) for side in (0, 1))
    shift = (other_lows + other_highs)[None] / 2 - (lows + highs)[:, None] / 2
    growth = (other_highs - other_lows)[None] - (highs - lows)[:, None]
    distance = np.linalg.norm(shift[..., :2], axis=2)
    cost = distance + SIZE_WEIGHT * np.abs(growth).sum(axis=2) + 2 * np.abs(shift[..., 2])
    cost[distance > MAX_SPEED * gap] = np.inf
    capped = np.minimum(cost, 2 * MAX_COST)
    pairs = zip(*linear_sum_assignment(capped), strict=True)
    flat = np.array([1.0, 1.0, 0.0])
    return [(int(a), int(b), shift[a, b] * flat / gap) for a, b in pairs if cost[a, b] < MAX_COST]
