"""Stray Gaussians in and around a compact object that belong to it, whatever their label says.

Inside the hull nothing is ever seen, so labels there are guesses: all that no other compact object owns is the
object's. Close around the hull a Gaussian is the object's where most of its neighbours are, and it has their colour.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float64
from numpy import ndarray
from scipy.spatial import KDTree

from instdrive_core.instances.interiors import CompactObject


@dataclass(frozen=True)
class FloaterConfig:
    """Which Gaussians belong to a compact object that it does not own yet."""

    growth: float = 1.15
    """Factor by which the hull is grown to look for them …"""
    margin: float = 0.2
    """… and metres by which it is grown on top."""
    neighbors: int = 8
    max_distance: float = 0.5
    """Metres to the farthest neighbour that counts."""
    min_share: float = 0.5
    """Least share of the neighbours that are the object's."""
    max_color_difference: float = 0.15
    """Largest difference of R, G or B to the mean of the neighbours that are the object's."""


DEFAULT_CONFIG = FloaterConfig()


def match_floaters(
    body: CompactObject,
    means: Float[ndarray, "n 3"],
    colors: Float[ndarray, "n 3"],
    owned: Bool[ndarray, " n"],
    claimed: Bool[ndarray, " n"],
    config: FloaterConfig = DEFAULT_CONFIG,
) -> Bool[ndarray, " n"]:
    """Match Gaussians near a compact object that become its own.

    Args:
        body: the object.
        means: metres, in the object's frame of reference.
        colors: RGB without view dependence.
        owned: the object's own, never part of the answer.
        claimed: those of other compact objects: only taken where they stand among the object's own.
    """
    local = (means.astype(np.float64) - body.center) @ body.axes
    above = local[:, 2] > body.floor
    inside = body.holds(local) & above & ~owned & ~claimed
    close = body.holds(local, config.growth, config.margin) & above & ~owned & ~inside
    asked = np.flatnonzero(close)
    if len(asked) and owned.any():
        inside[asked] = _find_resembling(local, colors, owned, asked, config)
    return inside


def _find_resembling(
    local: Float64[ndarray, "n 3"],
    colors: Float[ndarray, "n 3"],
    owned: Bool[ndarray, " n"],
    asked: ndarray,
    config: FloaterConfig,
) -> Bool[ndarray, " k"]:
    """Find the rows `asked` of whose neighbours enough are owned and look like them."""
    wanted = min(config.neighbors + 1, len(local))
    distances, found = KDTree(local).query(local[asked], k=wanted)
    counted = (distances <= config.max_distance) & (found != asked[:, None])
    mine = counted & owned[found]
    votes = mine.sum(axis=1)
    shares = votes / np.maximum(counted.sum(axis=1), 1)
    mean = (colors[found] * mine[..., None]).sum(axis=1) / np.maximum(votes, 1)[:, None]
    alike = np.abs(colors[asked] - mean).max(axis=1) <= config.max_color_difference
    return (shares >= config.min_share) & (votes > 0) & alike
