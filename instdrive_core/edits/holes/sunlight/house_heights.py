"""How high the houses of a row are, told by what ground in front of them lies in their shade.

Heights go on from place to place along the row and jump at times: a hidden Markov model, solved exactly by the forward
and backward pass (Rabiner 1989).
"""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float64, Int64
from numpy import ndarray

from instdrive_core.edits.holes.sunlight.standing_rows import HEIGHTS, LEVEL

JUMP = float(np.exp(-3.5))
"""Probability that the next place's height has nothing to do with this one's."""
TOP_ERROR = 0.3
"""Metres by which a top may be lower than it was seen."""
LOWER_COST = 3.0
"""Cost (negative logarithm) of a height lower than what was seen."""
UNSEEN_COST = 1.0
"""Cost of each metre that enough photos framed above the seen top and that shows nothing."""
ENOUGH_FRAMES = 4.0
_MOST_COST = 4.0


def weigh_seen_tops(tops: Float64[ndarray, " a"], framed: Float64[ndarray, "a h"]) -> Float64[ndarray, "a h"]:
    """Logarithms of the probability of each of `HEIGHTS` at each place, by what photos show of it and would show."""
    higher = tops[:, None] + TOP_ERROR < HEIGHTS
    empty = np.minimum(framed / ENOUGH_FRAMES, 1) * higher
    costs = UNSEEN_COST * LEVEL * np.cumsum(empty, axis=1) + LOWER_COST * (tops[:, None] - TOP_ERROR > HEIGHTS)
    likely = np.exp(-np.minimum(costs, _MOST_COST))
    return np.log(likely / likely.sum(axis=1, keepdims=True))


def add_ground(
    places: Int64[ndarray, " k"], needed: Float64[ndarray, " k"], told: Float64[ndarray, " k"], count: int
) -> Float64[ndarray, "a h"]:
    """Logarithms of how likely what is told of ground (`told`, of shade against sun) is for each height: the houses
    throw their shade on it if they are higher than `needed`, metres."""
    sums = np.zeros((count, len(HEIGHTS) + 1))
    np.add.at(sums, (places, np.clip(np.ceil(needed / LEVEL - 0.5), 0, len(HEIGHTS)).astype(np.int64)), told)
    return np.cumsum(sums, axis=1)[:, :-1]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def infer_heights(logs: Float64[ndarray, "a h"]) -> tuple[Float64[ndarray, "a h"], float]:
    """Probability of each height at each place, and the logarithm of the evidence."""
    count, levels = logs.shape
    forward, likely = np.empty((count, levels)), np.empty((count, levels))
    evidence = 0.0
    for i in range(count):
        most = logs[i].max()
        total = 0.0
        for k in range(levels):
            likely[i, k] = np.exp(logs[i, k] - most)
            before = 1.0 / levels if i == 0 else (1 - JUMP) * forward[i - 1, k] + JUMP / levels
            forward[i, k] = before * likely[i, k]
            total += forward[i, k]
        total = max(total, 1e-300)
        evidence += most + np.log(total)
        forward[i] /= total
    backward, result = np.ones(levels), np.empty((count, levels))
    for i in range(count - 1, -1, -1):
        result[i] = forward[i] * backward
        result[i] /= max(result[i].sum(), 1e-300)
        weighted = backward * likely[i]
        mean = weighted.sum() / levels
        backward = (1 - JUMP) * weighted + JUMP * mean
        backward /= max(backward.max(), 1e-300)
    return result, evidence
