"""Pictures of lenses that are no pinholes: looked up in pinhole pictures of the sides of a cube around the camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Float64
from numpy import ndarray
from scipy import ndimage

from instdrive_core.rasterize.scene_view import view_scene
from instdrive_core.scene.camera import Camera
from instdrive_core.scene.scene import Scene

NARROW = 0.6
"""Cosine of the angle off the axis up to which one pinhole picture is enough."""
_FINER = 1.25
"""Pixels of the sides for each of the lens's."""
_LARGEST_SIDE = 4096
_MARGIN = 2
"""Pixels around what is looked up."""
_SIDES = (
    np.eye(3),
    np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]),
    np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]]),
    np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
    np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
    np.array([[-1.0, 0, 0], [0, 1, 0], [0, 0, -1]]),
)
"""camera_from_side: ahead, right, left, down, up, back."""


@dataclass(frozen=True)
class LensRays:
    """Where each pixel of a lens looks, in the camera's axes."""

    directions: Float32[ndarray, "h w 3"]
    """Unit vectors: x right, y down, z forward."""
    seen: Bool[ndarray, "h w"]
    """Pixels that look anywhere."""


def view_through_lens(
    scene: Scene, rays: LensRays, world_from_camera: Float64[ndarray, "4 4"], time: float
) -> Float32[ndarray, "h w 3"]:
    """Draw the colours that a lens shows at `time` (seconds); black where it sees nothing."""
    picture = np.zeros(rays.directions.shape, np.float32)
    focal = _find_focal(rays)
    for side, rows in enumerate(_choose_sides(rays)):
        if len(rows):
            local = rays.directions.reshape(-1, 3)[rows].astype(np.float64) @ _SIDES[side]
            pose = world_from_camera.copy()
            pose[:3, :3] = world_from_camera[:3, :3] @ _SIDES[side]
            picture.reshape(-1, 3)[rows] = _look_up(scene, local, focal, pose, time)
    return picture


def _choose_sides(rays: LensRays) -> list[ndarray]:
    """Pixels by the side of the cube that they look at."""
    seen = np.flatnonzero(rays.seen)
    looks = rays.directions.reshape(-1, 3)[seen]
    if not len(seen) or looks[:, 2].min() > NARROW:
        return [seen]
    x, y, z = looks.T
    nearest = np.stack([z, x, -x, y, -y, -z]).argmax(axis=0)
    return [seen[nearest == side] for side in range(len(_SIDES))]


def _find_focal(rays: LensRays) -> float:
    """Pixels per radian: as fine as the lens is for half of its pixels."""
    both = rays.seen[:, 1:] & rays.seen[:, :-1]
    steps = np.linalg.norm(np.diff(rays.directions, axis=1), axis=2)[both]
    steps = steps[steps > 0]
    return _FINER / float(np.median(steps)) if len(steps) else 1.0


def _look_up(
    scene: Scene, local: Float64[ndarray, "p 3"], focal: float, pose: Float64[ndarray, "4 4"], time: float
) -> Float32[ndarray, "p 3"]:
    """Colours along directions, given in the axes of one side."""
    slopes = local[:, :2] / local[:, 2:]
    low, high = slopes.min(axis=0), slopes.max(axis=0)
    focal = min(focal, (_LARGEST_SIDE - 2 * _MARGIN - 1) / max(float((high - low).max()), 1e-9))
    width, height = (np.ceil(focal * (high - low)).astype(int) + 2 * _MARGIN + 1).tolist()
    center = _MARGIN - focal * low
    drawn = view_scene(scene, Camera(focal, focal, center[0], center[1], width, height, pose), time).color
    at = (focal * slopes + center - 0.5).T[::-1]
    return np.stack([ndimage.map_coordinates(drawn[:, :, k], at, order=1, mode="nearest") for k in range(3)], axis=1)
