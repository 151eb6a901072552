"""The ground along the way of a camera, from points that stand still."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64
from numpy import ndarray
from scipy.spatial import KDTree

_REACH = 20.0
"""Metres from the way within which points count."""
_FEWEST = 30
"""Points without which nothing is said about the ground."""
_HIGHEST = 6.0
"""Metres of a camera above the ground."""


def measure_camera_height(positions: Float64[ndarray, "f 3"], points: Float64[ndarray, "n 3"]) -> float | None:
    """Measure how high a camera rides above the ground; None where too few points lie below it.

    The ground is the height below the camera at which most points lie. Metres.

    Args:
        positions: of the camera, photo by photo.
        points: that stand still, from any camera.
    """
    distances, nearest = KDTree(positions[:, :2]).query(points[:, :2])
    drops = positions[nearest, 2] - points[:, 2]
    drops = np.sort(drops[(distances < _REACH) & (drops > 0.2) & (drops < _HIGHEST)])
    if len(drops) < _FEWEST:
        return None
    low, high = np.searchsorted(drops, drops * 0.92), np.searchsorted(drops, drops * 1.08)
    densities = (high - low) / drops
    best = int(np.argmax(densities))
    return float(np.median(drops[low[best] : high[best]]))


def find_least_inverse_depths(
    rays: Float64[ndarray, "n 3"],
    origins: Float64[ndarray, "n 3"],
    height: float,
    slack: float,
    farthest: float,
) -> Float64[ndarray, " n"]:
    """Find the inverse depth below which a standing point would lie under the ground, 1/m; 0 where nothing is said.

    Args:
        rays: viewing directions in the world, one metre along the optical axis.
        origins: camera positions.
        height: of the camera above the ground, metres.
        slack: share of the ground's inverse depth that is asked for: the ground is not flat.
        farthest: metres along the axis up to which the ground's place is believed.
    """
    inverse = -rays[:, 2] / height
    return np.where(inverse > 1 / farthest, slack * inverse, 0.0)
