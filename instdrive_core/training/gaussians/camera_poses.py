"""Corrections of the cameras' poses, learned beside the scene: where each camera sits on the vehicle, and each photo.

Calibrations are off by a few milliradians and centimetres, which is a pixel or two. A photo's pose is that of the clip,
moved in the camera's own axes by the sum of two corrections: one that all photos of a camera share, and a small one of
its own, which is pulled back to zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float64
from numpy import ndarray
from scipy.spatial.transform import Rotation
from torch import Tensor

from instdrive_core.scene.camera import Camera, CameraView
from instdrive_core.scene.exposure import parse_photo_camera
from instdrive_core.training.gaussians.visible_adam import VisibleAdam
from instdrive_core.training.settings.config import GeometryConfig
from instdrive_core.training.views.view_store import ViewFacts

_PARTS = ("shifts", "turns")
_LEVELS = ("rig", "photos")


class CameraPoses:
    """Learned poses of the training photos.

    Args:
        photos: the training photos, whose cameras are the clip's.
        config: rates; both 0 = poses stay as given.
    """

    def __init__(self, photos: Sequence[ViewFacts], config: GeometryConfig) -> None:
        self._photos = tuple(photos)
        names = [parse_photo_camera(photo.key) for photo in photos]
        self._names = sorted(set(names))
        self._camera = [self._names.index(name) for name in names]
        """Number of the camera that took each photo."""
        self._rates = {"rig": config.rig_lr, "photos": config.photo_lr}
        self._decay = config.photo_decay
        counts = {"rig": len(self._names), "photos": len(self._photos)}
        self._values = {level: {part: torch.zeros(counts[level], 3) for part in _PARTS} for level in _LEVELS}
        """Shifts (metres) and turns (rotation vectors, radians) in camera axes."""
        self._adam = {level: VisibleAdam(self._values[level], dict.fromkeys(_PARTS, 0.0)) for level in _LEVELS}

    @property
    def are_learned(self) -> bool:
        """Whether any pose may change."""
        return any(self._rates.values())

    def correct(self, number: int, camera: Camera) -> Camera:
        """Move a photo's camera, at any resolution, by the photo's corrections."""
        return move_camera(camera, self._get_correction(number))

    def step(
        self,
        number: int,
        camera: Camera,
        force: Float64[ndarray, "3"],
        torque: Float64[ndarray, "3"],
        progress: float,
    ) -> None:
        """Descend a photo's corrections, and those of its camera.

        Args:
            number: of the photo.
            camera: it was drawn with.
            force: gradient of the loss along a shift of the whole scene in the world, per metre.
            torque: the same along a turn of the scene about the world's origin, per radian.
            progress: share of the stage that is done; rates fall exponentially to a tenth.
        """
        into_camera = -camera.world_from_camera[:3, :3].T  # the camera moves against the scene
        about_camera = torque - np.cross(camera.position, force)
        found = {"shifts": into_camera @ force, "turns": into_camera @ about_camera}
        gradients = {part: torch.from_numpy(found[part][None].astype(np.float32)) for part in _PARTS}
        for level, row in (("rig", self._camera[number]), ("photos", number)):
            rate = self._rates[level] * 0.1**progress
            if rate:
                self._adam[level].rates = {"shifts": rate, "turns": rate / 10}
                self._adam[level].step(np.array([row], np.int64), dict(gradients))
        for part in _PARTS:
            self._values["photos"][part][number] *= 1 - self._decay

    def start_from(self, views: Sequence[CameraView]) -> None:
        """Take poses over from views of a scene trained on the same clip; photos that it lacks stay as they are."""
        known = {f"{view.name}/{view.index:02d}": view.camera for view in views}
        found = {
            number: find_correction(photo.camera, known[photo.key])
            for number, photo in enumerate(self._photos)
            if photo.key in known
        }
        for camera in range(len(self._names)):
            of_camera = [found[number] for number in found if self._camera[number] == camera]
            if of_camera:
                _write(self._values["rig"], camera, np.mean(of_camera, axis=0))
        for number, correction in found.items():
            _write(self._values["photos"], number, correction - _read(self._values["rig"], self._camera[number]))

    def list_poses(self) -> list[Float64[ndarray, "4 4"]]:
        """List world_from_camera of each training photo."""
        return [self.correct(number, photo.camera).world_from_camera for number, photo in enumerate(self._photos)]

    def correct_views(self, views: Sequence[CameraView]) -> tuple[CameraView, ...]:
        """Correct a clip's views: training photos by their own corrections, others by those of the photos before and
        after them that the same camera took, interpolated linearly over time."""
        return tuple(replace(view, camera=move_camera(view.camera, self._interpolate(view))) for view in views)

    def state_tensors(self) -> dict[str, Tensor]:
        """Tensors that a resumed run needs, by name."""
        tensors: dict[str, Tensor] = {}
        for level in _LEVELS:
            tensors |= {f"{level}.{part}": value for part, value in self._values[level].items()}
            tensors |= {f"{level}.adam.{name}": value for name, value in self._adam[level].state_tensors().items()}
        return tensors

    def load_state_tensors(self, tensors: dict[str, Tensor]) -> None:
        """The inverse of `state_tensors`."""
        for level in _LEVELS:
            prefix = f"{level}.adam."
            state = {name.removeprefix(prefix): value for name, value in tensors.items() if name.startswith(prefix)}
            self._adam[level].load_state_tensors(state)
            for part in _PARTS:
                self._values[level][part].copy_(tensors[f"{level}.{part}"])

    def _get_correction(self, number: int) -> Float64[ndarray, "6"]:
        return _read(self._values["rig"], self._camera[number]) + _read(self._values["photos"], number)

    def _interpolate(self, view: CameraView) -> Float64[ndarray, "6"]:
        if view.name not in self._names:
            return np.zeros(6)
        camera = self._names.index(view.name)
        taken = [number for number, other in enumerate(self._camera) if other == camera]
        taken.sort(key=lambda number: self._photos[number].time)
        times = [self._photos[number].time for number in taken]
        values = np.array([self._get_correction(number) for number in taken])
        return np.array([np.interp(view.time, times, values[:, entry]) for entry in range(6)])


def _read(values: dict[str, Tensor], row: int) -> Float64[ndarray, "6"]:
    return np.concatenate([values[part][row].double().numpy() for part in _PARTS])


def _write(values: dict[str, Tensor], row: int, correction: Float64[ndarray, "6"]) -> None:
    for part, entries in zip(_PARTS, np.split(correction.astype(np.float32), 2), strict=True):
        values[part][row] = torch.from_numpy(entries)


def move_camera(camera: Camera, correction: Float64[ndarray, "6"]) -> Camera:
    """Move a camera in its own axes: shifted by the first three entries (metres), turned by the last (radians)."""
    if not correction.any():
        return camera
    move = np.eye(4)
    move[:3, :3], move[:3, 3] = Rotation.from_rotvec(correction[3:]).as_matrix(), correction[:3]
    return replace(camera, world_from_camera=camera.world_from_camera @ move)


def find_correction(camera: Camera, moved: Camera) -> Float64[ndarray, "6"]:
    """Find the correction that `move_camera` makes `moved`'s pose of `camera`'s with."""
    move = camera.camera_from_world @ moved.world_from_camera
    return np.concatenate([move[:3, 3], Rotation.from_matrix(move[:3, :3]).as_rotvec()])
