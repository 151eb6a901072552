"""The direction of the lane: where the recording car drove, or where the street runs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

NEAR = 20.0
"""Metres: the drive counts by a bell curve of this width around the place asked for."""
MIN_STEP = 0.05
"""Metres: shorter steps between two photos are noise of a standing car."""


def estimate_travel_direction(
    paths: Sequence[Float[ndarray, "t 3"]], near: Float[ndarray, "3"]
) -> Float64[ndarray, "3"] | None:
    """Estimate the horizontal unit direction of the drive past `near`; None where nothing drove.

    Args:
        paths: each camera's positions in the order of time, metres.
        near: a place, metres.

    Steps count by their length and nearness; a street that was driven both ways has the direction of the longer way.
    """
    steps = np.concatenate([np.zeros((0, 2)), *(np.diff(path[:, :2], axis=0) for path in paths)])
    middles = np.concatenate([np.zeros((0, 2)), *((path[1:, :2] + path[:-1, :2]) / 2 for path in paths)])
    lengths = np.linalg.norm(steps, axis=1)
    kept = lengths >= MIN_STEP
    if not kept.any():
        return None
    steps, lengths = steps[kept], lengths[kept]
    distances = np.linalg.norm(middles[kept] - np.asarray(near)[:2], axis=1)
    # Relative to the nearest step, so that a place far from the drive has a lane, too.
    weights = np.exp((distances.min() ** 2 - distances**2) / (2 * NEAR**2))
    return _find_main_axis(steps, weights / lengths, weights @ steps)


def estimate_street_direction(points: Float[ndarray, "n 3"], near: Float[ndarray, "3"]) -> Float64[ndarray, "3"] | None:
    """Estimate the horizontal unit direction in which points within twice `NEAR` metres extend most.

    None for fewer than two points.
    """
    offsets = points[:, :2] - np.asarray(near, points.dtype)[:2]
    close = offsets[(offsets**2).sum(axis=1) < (2 * NEAR) ** 2].astype(np.float64)
    if len(close) < 2:
        return None
    close -= close.mean(axis=0)
    return _find_main_axis(close, np.ones(len(close)), np.array([1.0, 1.0]))


def _find_main_axis(
    vectors: Float64[ndarray, "n 2"], weights: Float64[ndarray, " n"], towards: Float64[ndarray, "2"]
) -> Float64[ndarray, "3"]:
    axis = np.linalg.eigh((vectors * weights[:, None]).T @ vectors)[1][:, 1]
    axis = axis if axis @ towards >= 0 else -axis
    return np.array([axis[0], axis[1], 0.0])
