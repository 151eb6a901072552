"""A world with z up for cameras that nobody has levelled, and a unit that may be taken for metres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

_CLEAR = 0.3
"""Length that the mean of unit up vectors needs to mean anything."""
PLAUSIBLE = (2.0, 200.0)
"""Median distance from a street's cameras to what they see, were it metres."""
ASSUMED = 15.0
"""Metres that an implausible median distance is taken for."""
_MOST_LOOKED_AT = 2_000


@dataclass(frozen=True)
class Upright:
    """From a file's world to the clip's: turn, then scale."""

    rotation: Float64[ndarray, "3 3"]
    scale: float
    """Metres (assumed) per unit of the file."""
    notes: tuple[str, ...]

    def poses(self, world_from_camera: Float64[ndarray, "n 4 4"]) -> Float64[ndarray, "n 4 4"]:
        """Poses in the clip's world."""
        turned = world_from_camera.copy()
        turned[:, :3, :3] = self.rotation @ world_from_camera[:, :3, :3]
        turned[:, :3, 3] = self.points(world_from_camera[:, :3, 3])
        return turned

    def points(self, points: Float[ndarray, "n 3"]) -> Float64[ndarray, "n 3"]:
        """Points in the clip's world."""
        return points.astype(np.float64) @ self.rotation.T * self.scale


def upright_world(world_from_camera: Float64[ndarray, "n 4 4"], points: Float[ndarray, "m 3"]) -> Upright:
    """Up is the mean of the cameras' up vectors; the unit is the file's, unless no street could have it.

    Args:
        world_from_camera: poses in the file's world, OpenCV axes.
        points: what the cameras see, in the same world; may be empty.
    """
    up = -world_from_camera[:, :3, 1].mean(axis=0)
    length = float(np.linalg.norm(up))
    if length < _CLEAR:
        rotation = np.eye(3)
        turned = "the cameras' up vectors contradict each other: the file's z axis is taken to point up"
    else:
        rotation = rotation_to_z(up / length)
        turned = "up is estimated from the cameras"
    scale, unit = _unit(world_from_camera[:, :3, 3], points)
    return Upright(rotation, scale, (turned, f"the scale is unknown: {unit}"))


def rotation_to_z(up: Float64[ndarray, "3"]) -> Float64[ndarray, "3 3"]:
    """The smallest rotation that carries the unit vector `up` to (0, 0, 1)."""
    axis, cosine = np.cross(up, [0.0, 0.0, 1.0]), up[2]
    if cosine < -1 + 1e-9:
        return np.diag([1.0, -1.0, -1.0])
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + cross + cross @ cross / (1 + cosine)


def _unit(centers: Float64[ndarray, "n 3"], points: Float[ndarray, "m 3"]) -> tuple[float, str]:
    """Metres per unit, and how that was chosen."""
    if len(points):
        some = points[:: max(1, len(points) // _MOST_LOOKED_AT)]
        reach = float(np.median(np.linalg.norm(some - centers[np.arange(len(some)) % len(centers)], axis=1)))
    else:
        reach = float(np.linalg.norm(centers - centers.mean(axis=0), axis=1).max())
    if reach == 0 or PLAUSIBLE[0] <= reach <= PLAUSIBLE[1]:
        return 1.0, "a unit of the file is taken for a metre"
    scale = ASSUMED / reach
    return scale, f"a unit of the file is taken for {scale:.3g} m, so that things are {ASSUMED:g} m away in the middle"
