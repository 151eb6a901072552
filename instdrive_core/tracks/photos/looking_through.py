"""Whether other photos look through the places at which points would have to stand."""

from __future__ import annotations

from collections.abc import Sequence

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


def find_looked_through(
    points: Float64[ndarray, "n 3"],
    own: Sequence[Bool[ndarray, " n"]],
    cameras: Sequence[Camera],
    corners: Sequence[Float64[ndarray, "k 2"]],
    nearest_depths: Sequence[Float64[ndarray, " k"]],
    depths: Sequence[Float64[ndarray, " k"]],
) -> Bool[ndarray, " n"]:
    """Find the points at whose place at least three photos show what lies behind, and hardly any shows something.

    Args:
        points: places in the world.
        own: for each photo, the points that were measured in it; they are not asked for there.
        cameras: of all photos.
        corners: for each photo, pixels of corners that stand still.
        nearest_depths: for each photo, the smallest depth that each corner may have, metres.
        depths: for each photo, the likely depth of each corner, metres.
    """
    through, met = np.zeros(len(points), np.int64), np.zeros(len(points), np.int64)
    for camera, mine, places, near, likely in zip(cameras, own, corners, nearest_depths, depths, strict=True):
        if not len(places):
            continue
        pixels, depth = camera.project(points)
        inside = (depth > 1) & (pixels > 0).all(axis=1) & (pixels[:, 0] < camera.width) & (pixels[:, 1] < camera.height)
        rows = np.flatnonzero(inside & ~mine)
        distances, index = KDTree(places).query(pixels[rows], distance_upper_bound=_BESIDE)
        beside = np.isfinite(distances)
        rows, index = rows[beside], index[beside]
        through[rows] += near[index] > _BEHIND * depth[rows]
        met[rows] += np.abs(likely[index] / depth[rows] - 1) < _CLOSE
    return (through >= _LEAST_LOOKS) & (through > 2 * met)
