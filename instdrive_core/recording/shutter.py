"""The rolling shutter of recorded cameras: where each camera is while its lines are exposed."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.errors import OptionError
from instdrive_core.maths.rotations import matrix_from_quaternion, quaternion_from_matrix, slerp
from instdrive_core.rasterize.rolling_shutter import Direction, RollingCamera
from instdrive_core.scene.camera import CameraView

LONGEST = 0.1
"""Seconds from a picture's first to its last line, at most."""
_DIRECTIONS: dict[str, Direction] = {"down": "down", "up": "up", "left": "left", "right": "right"}


@dataclass(frozen=True)
class Shutter:
    """How lines are exposed; a picture's moment is the middle of it."""

    seconds: float
    """From the first line to the last."""
    direction: Direction = "down"
    """Which way the exposed line goes."""


@dataclass(frozen=True)
class CameraWay:
    """Where one camera is over time."""

    times: Float64[ndarray, " t"]
    """Seconds, rising."""
    world_from_camera: Float64[ndarray, "t 4 4"]

    def find_pose(self, time: float) -> Float64[ndarray, "4 4"]:
        """Find the pose at a time: between steps evenly, beyond them as between the nearest two."""
        if len(self.times) == 1:
            return self.world_from_camera[0].copy()
        lower = int(np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, len(self.times) - 2))
        share = float((time - self.times[lower]) / (self.times[lower + 1] - self.times[lower]))
        start, end = self.world_from_camera[lower], self.world_from_camera[lower + 1]
        quats = quaternion_from_matrix(np.stack([start[:3, :3], end[:3, :3]]))
        pose = np.eye(4)
        pose[:3, :3] = matrix_from_quaternion(slerp(quats[0], quats[1], share))
        pose[:3, 3] = (1 - share) * start[:3, 3] + share * end[:3, 3]
        return pose


@dataclass(frozen=True)
class RollingRig:
    """Cameras with a rolling shutter on the way that is recorded."""

    shutter: Shutter
    ways: Mapping[str, CameraWay]
    """By the cameras' names."""

    def roll(self, view: CameraView) -> RollingCamera:
        """Return the view's camera as it moves while its lines are exposed."""
        way, half = self.ways[view.name], self.shutter.seconds / 2
        first, last = view.time - half, view.time + half
        return RollingCamera(
            view.camera, way.find_pose(first), way.find_pose(last), first, last, self.shutter.direction
        )


def parse_shutter(text: str) -> Shutter:
    """Parse ``0.03`` or ``0.03@left``. Raises OptionError."""
    found = re.fullmatch(r"(\d+(?:\.\d+)?)(?:@(\w+))?", text.strip())
    if found is None or (found[2] is not None and found[2] not in _DIRECTIONS):
        raise OptionError(
            f"{text!r} is no shutter; write SECONDS or SECONDS@{'|'.join(_DIRECTIONS)}, such as 0.03@down"
        )
    seconds = float(found[1])
    if not 0 < seconds <= LONGEST:
        raise OptionError(f"{text!r}: a shutter takes more than 0 and at most {LONGEST:g} s from first to last line")
    return Shutter(seconds, _DIRECTIONS[found[2] or "down"])


def build_rolling_rig(shutter: Shutter, views: Sequence[CameraView]) -> RollingRig:
    """Build the rig of cameras that roll.

    Args:
        shutter: of all of them.
        views: of all cameras at all moments, on the way that is recorded.
    """
    poses: dict[str, dict[float, Float64[ndarray, "4 4"]]] = {}
    for view in views:
        poses.setdefault(view.name, {})[view.time] = view.camera.world_from_camera
    return RollingRig(
        shutter,
        {
            name: CameraWay(np.array(sorted(known)), np.stack([known[time] for time in sorted(known)]))
            for name, known in poses.items()
        },
    )
