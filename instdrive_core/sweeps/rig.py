"""The rig that carries the sensor: where it is at any time, from the cameras on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.errors import OptionError
from instdrive_core.maths.rotations import matrix_from_quaternion, quaternion_from_matrix, slerp
from instdrive_core.scene.camera import CameraView

_RIG_FROM_CAMERA = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
"""From right, down, forward to forward, left, up."""
_PARTS = 64
"""Even parts of a step in which the rig's turn is taken to be the same."""
_KEYS = 3 * _PARTS + 1
"""Parts from a step before to a step behind."""


@dataclass(frozen=True)
class Rig:
    """A frame amid the cameras: x as the first one looks, y to its left, z up."""

    times: Float64[ndarray, " t"]
    """Seconds, rising."""
    world_from_rig: Float64[ndarray, "t 4 4"]

    def place(self, times: Float64[ndarray, " n"]) -> tuple[Float64[ndarray, "n 3"], Float64[ndarray, "n 3 3"]]:
        """Places (metres) and turns of the rig: between steps evenly, beyond them as between the nearest two."""
        if len(self.times) == 1:
            pose = self.world_from_rig[0]
            return np.repeat(pose[None, :3, 3], len(times), 0), np.repeat(pose[None, :3, :3], len(times), 0)
        lower = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(self.times) - 2)
        share = (times - self.times[lower]) / (self.times[lower + 1] - self.times[lower])
        share = np.clip(share, -1.0, 2.0)
        places = self.world_from_rig[:, :3, 3]
        quats = quaternion_from_matrix(self.world_from_rig[:, :3, :3])
        # Turns between two steps are small: a few even parts of each are exact enough, and quick.
        keys = lower * _KEYS + np.round(share * _PARTS).astype(np.int64) + _PARTS
        used = np.flatnonzero(np.bincount(keys))
        steps = (divmod(key, _KEYS) for key in used.tolist())
        turned = [slerp(quats[low], quats[low + 1], part / _PARTS - 1) for low, part in steps]
        numbers = np.zeros(int(keys.max(initial=0)) + 1, np.int64)
        numbers[used] = np.arange(len(used))
        turns = matrix_from_quaternion(np.stack(turned))[numbers[keys]]
        return places[lower] + share[:, None] * (places[lower + 1] - places[lower]), turns


def build_rig(views: Sequence[CameraView]) -> Rig:
    """Build the rig of photo cameras: amid those of a step, levelled as the first camera is, at their mean time.

    Steps at which a camera is missing are passed over. Raises OptionError where there are no cameras.
    """
    steps: dict[int, list[CameraView]] = {}
    for view in views:
        steps.setdefault(view.index, []).append(view)
    if not steps:
        raise OptionError("the scene keeps no photo cameras, so nothing says where the sensor is")
    names = {view.name for view in views}
    count = max(len(found) for found in steps.values())
    first = views[0].name if len(names) > 1 else next(iter(names))
    times, poses = [], []
    for found in steps.values():
        leading = [view for view in found if view.name == first]
        if len(found) < count or not leading:
            continue
        pose = np.eye(4)
        pose[:3, :3] = leading[0].camera.world_from_camera[:3, :3] @ _RIG_FROM_CAMERA.T
        pose[:3, 3] = np.mean([view.camera.position for view in found], axis=0)
        times.append(float(np.mean([view.time for view in found])))
        poses.append(pose)
    order = np.argsort(times)
    rising = np.r_[True, np.diff(np.array(times)[order]) > 0]
    kept = order[rising]
    return Rig(np.array(times)[kept], np.stack(poses)[kept])
