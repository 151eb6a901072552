"""A world with z up for cameras that nobody has levelled, and a unit that may be taken for metres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray
from scipy.spatial import KDTree

from instdrive_core.scene.upright import compute_upright_rotation

_CLEAR = 0.3
"""Length that the mean of unit up vectors needs to mean anything."""
PLAUSIBLE_REACH = (1.0, 100.0)
"""Median distance of points from the nearest camera of a drive, were it metres."""
PLAUSIBLE_SPREAD = (2.0, 10_000.0)
"""Largest distance of a camera from the cameras' mean, were it metres; looked at where there are no points. Many tools
shrink all cameras into a cube from -1 to 1."""
ASSUMED = 15.0
"""Metres that an implausible distance is taken for."""
_MOST_LOOKED_AT = 20_000


@dataclass(frozen=True)
class UprightWorld:
    """Transform from a file's world to the clip's: a turn, then a scale."""

    rotation: Float64[ndarray, "3 3"]
    scale: float
    """Metres (assumed) per unit of the file."""
    notes: tuple[str, ...]

    def transform_poses(self, world_from_camera: Float64[ndarray, "n 4 4"]) -> Float64[ndarray, "n 4 4"]:
        """Transform poses to the clip's world."""
        turned = world_from_camera.copy()
        turned[:, :3, :3] = self.rotation @ world_from_camera[:, :3, :3]
        turned[:, :3, 3] = self.transform_points(world_from_camera[:, :3, 3])
        return turned

    def transform_points(self, points: Float[ndarray, "n 3"]) -> Float64[ndarray, "n 3"]:
        """Transform points to the clip's world."""
        return points.astype(np.float64) @ self.rotation.T * self.scale


def find_upright_world(world_from_camera: Float64[ndarray, "n 4 4"], points: Float[ndarray, "m 3"]) -> UprightWorld:
    """Find a world whose z is up: the mean of the cameras' up vectors; the unit is the file's unless no street has it.

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
        rotation = compute_upright_rotation(up)
        turned = "up is estimated from the cameras"
    scale, unit = _choose_unit(world_from_camera[:, :3, 3], points)
    return UprightWorld(rotation, scale, (turned, f"the scale is unknown: {unit}"))


def _choose_unit(centers: Float64[ndarray, "n 3"], points: Float[ndarray, "m 3"]) -> tuple[float, str]:
    """Choose metres per unit, and say how."""
    if len(points):
        some = points[:: max(1, len(points) // _MOST_LOOKED_AT)]
        distance, plausible = float(np.median(KDTree(centers).query(some)[0])), PLAUSIBLE_REACH
        what = f"half of the points lie within {ASSUMED:g} m of a camera"
    else:
        distance, plausible = float(np.linalg.norm(centers - centers.mean(axis=0), axis=1).max()), PLAUSIBLE_SPREAD
        what = f"the cameras lie within {ASSUMED:g} m of their middle"
    if distance == 0 or plausible[0] <= distance <= plausible[1]:
        return 1.0, "a unit of the file is taken for a metre"
    scale = ASSUMED / distance
    return scale, f"a unit of the file is taken for {scale:.3g} m, so that {what}"
