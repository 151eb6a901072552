"""Stray Gaussians in and around a compact object that belong to it, whatever their label says.

Inside the hull nothing is ever seen, so labels there are guesses: all that no other compact object owns is the body's.
Close around the hull a Gaussian is the body's where most of its neighbours are, and it has their colour.
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
    """What belongs to a body that it does not own yet."""

    growth: float = 1.15
    """Looked for in the hull grown by this factor …"""
    margin: float = 0.2
    """… and so many metres."""
    neighbors: int = 8
    max_distance: float = 0.5
    """Metres to the farthest neighbour that counts."""
    min_share: float = 0.5
    """Of the neighbours, the body's."""
    max_color_difference: float = 0.15
    """Largest difference of R, G or B to the mean of the body's neighbours."""


DEFAULT_CONFIG = FloaterConfig()


def match_floaters(
    body: CompactObject,
    means: Float[ndarray, "n 3"],
    colors: Float[ndarray, "n 3"],
    owned: Bool[ndarray, " n"],
    claimed: Bool[ndarray, " n"],
    config: FloaterConfig = DEFAULT_CONFIG,
) -> Bool[ndarray, " n"]:
    """Which Gaussians near a body become the body's.

    Args:
        means: metres, in the body's frame of reference.
        colors: RGB without view dependence.
        owned: the body's own, never part of the answer.
        claimed: those of other compact objects: only taken where they stand among the body's own.
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
    """Whether enough of the neighbours of each row `asked` are owned, and look like it."""
    wanted = min(config.neighbors + 1, len(local))
    distances, found = KDTree(local).query(local[asked], k=wanted)
    counted = (distances <= config.max_distance) & (found != asked[:, None])
    mine = counted & owned[found]
    votes = mine.sum(axis=1)
    shares = votes / np.maximum(counted.sum(axis=1), 1)
    mean = (colors[found] * mine[..., None]).sum(axis=1) / np.maximum(votes, 1)[:, None]
    alike = np.abs(colors[asked] - mean).max(axis=1) <= config.max_color_difference
    return (shares >= config.min_share) & (votes > 0) & alike
