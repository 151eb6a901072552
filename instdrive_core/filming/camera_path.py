"""A camera's smooth path through keys."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64
from numpy import ndarray
from scipy.spatial.transform import Rotation, RotationSpline

from instdrive_core.scene.camera import Camera
from instdrive_core.scene.pose_transforms import transform_pose
from instdrive_core.scene.transforms import Similarity

CLOSEST = 0.1
"""Seconds between two keys, at least."""


@dataclass(frozen=True)
class CameraKey:
    """Where the camera is at one moment of the film."""

    at: float
    """Seconds into the film."""
    time: float
    """Seconds into the drive that are shown then."""
    camera: Camera


class CameraPath:
    """Passes through every key: positions on Akima splines, directions on a spline of rotations.

    Both have no jump in speed, and neither swings out where neighbouring keys stand still. The drive's time and the
    lens go along; the drive's time runs evenly from key to key.
    """

    def __init__(self, keys: Sequence[CameraKey]) -> None:
        """`keys`: at least one, at rising seconds. Raises ValueError otherwise."""
        self._times = np.array([key.at for key in keys], float)
        if not len(keys) or (np.diff(self._times) <= 0).any():
            raise ValueError("a path needs at least one key, and keys at rising seconds")
        self._keys = tuple(keys)
        places = np.array([key.camera.position for key in keys])
        lenses = np.array([_normalize_lens(key.camera) for key in keys])
        if len(keys) > 1:
            from scipy.interpolate import Akima1DInterpolator  # a quarter second, which the editor would start later

            self._place = Akima1DInterpolator(self._times, places, method="makima")
            self._lens = Akima1DInterpolator(self._times, lenses, method="makima")
            turns = Rotation.from_matrix(np.array([key.camera.world_from_camera[:3, :3] for key in keys]))
            self._turn = RotationSpline(self._times, turns)

    @property
    def start(self) -> float:
        """Seconds of the first key."""
        return float(self._times[0])

    @property
    def end(self) -> float:
        """Seconds of the last key."""
        return float(self._times[-1])

    def find_drive_time(self, at: float) -> float:
        """Find the seconds into the drive that are shown `at` seconds into the film."""
        return float(np.interp(at, self._times, [key.time for key in self._keys]))

    def find_camera(self, at: float, width: int, height: int) -> Camera:
        """Find the camera `at` seconds into the film; the keys' whole films are inside a picture of this size."""
        at = float(np.clip(at, self.start, self.end))
        if len(self._keys) == 1:
            pose, lens = self._keys[0].camera.world_from_camera, _normalize_lens(self._keys[0].camera)
        else:
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = self._turn(at).as_matrix(), self._place(at)
            lens = np.asarray(self._lens(at))
        fx, fy, right, down, aspect = lens.tolist()
        unit = min(width / aspect, height)
        return Camera(fx * unit, fy * unit, width / 2 + right * unit, height / 2 + down * unit, width, height, pose)

    def transform(self, matrix: Similarity) -> tuple[CameraKey, ...]:
        """Compute the keys after the whole scene was transformed by [s R | t]."""
        return tuple(
            replace(
                key, camera=replace(key.camera, world_from_camera=transform_pose(key.camera.world_from_camera, matrix))
            )
            for key in self._keys
        )


def _normalize_lens(camera: Camera) -> Float64[ndarray, "5"]:
    """Focal lengths, the centre's offset and the width, as shares of the picture's height."""
    offset = camera.cx - camera.width / 2, camera.cy - camera.height / 2
    return np.array([camera.fx, camera.fy, *offset, camera.width], float) / camera.height
