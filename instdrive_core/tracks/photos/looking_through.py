"""Whether other photos look through the places at which points would have to stand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64
from numpy import ndarray
from scipy.spatial import KDTree

from instdrive_core.scene.camera import Camera

_BESIDE = 4.0
"""Pixels within which a corner tells what a photo shows at a place."""
_BEHIND = 1.35
"""Times the distance beyond which a corner lies behind a place."""
_CLOSE = 0.15
"""Share of the distance within which a corner is met at a place."""
_LEAST_LOOKS = 3


@dataclass(frozen=True)
class ShownCorners:
    """Corners of one photo that stand still."""

    camera: Camera
    places: Float64[ndarray, "k 2"]
    """Column and row, pixels."""
    nearest: Float64[ndarray, " k"]
    """The smallest depth that each may have, metres along the optical axis."""
    depths: Float64[ndarray, " k"]
    """The likely depth of each."""


def find_looked_through(
    points: Float64[ndarray, "n 3"], own: Bool[ndarray, "p n"], photos: Sequence[ShownCorners]
) -> Bool[ndarray, " n"]:
    """Find the points at whose place at least three photos show what lies behind, and hardly any shows something.

    Args:
        points: places in the world.
        own: photo × point: whether the point was measured in the photo, which is not asked then.
        photos: what the photos show.
    """
    through, met = np.zeros(len(points), np.int64), np.zeros(len(points), np.int64)
    for photo, measured in zip(photos, own, strict=True):
        if not len(photo.places):
            continue
        pixels, depth = photo.camera.project(points)
        size = [photo.camera.width, photo.camera.height]
        inside = (depth > 1) & (pixels > 0).all(axis=1) & (pixels < size).all(axis=1)
        rows = np.flatnonzero(inside & ~measured)
        found = KDTree(photo.places).query(pixels[rows], distance_upper_bound=_BESIDE)
        distances, index = map(np.atleast_1d, found)
        beside = np.isfinite(distances)
        rows, index = rows[beside], index[beside]
        through[rows] += photo.nearest[index] > _BEHIND * depth[rows]
        met[rows] += np.abs(photo.depths[index] / depth[rows] - 1) < _CLOSE
    return (through >= _LEAST_LOOKS) & (through > 2 * met)
