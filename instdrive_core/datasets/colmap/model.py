"""What a COLMAP model says of cameras, photos and points, and the checks that text and binary files share.

Layout after COLMAP's documentation of its output format (``cameras``, ``images``, ``points3D``, as .bin or .txt).
pycolmap is not used to read: it takes memory by counts before it checks them, and passes poses that are NaN
(docs/datasets.md).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.datasets.distortion import AnyDistortion, Distortion
from instdrive_core.datasets.fisheye import Fisheye
from instdrive_core.datasets.posed_photos import ListedPoints, build_camera
from instdrive_core.errors import DataError
from instdrive_core.maths.rotations import matrix_from_quaternion
from instdrive_core.scene.camera import Camera

REMEDY = "Copy the model again, or write it again with COLMAP"
MODELS = {
    0: ("SIMPLE_PINHOLE", 3),
    1: ("PINHOLE", 4),
    2: ("SIMPLE_RADIAL", 4),
    3: ("RADIAL", 5),
    4: ("OPENCV", 8),
    5: ("OPENCV_FISHEYE", 8),
    6: ("FULL_OPENCV", 12),
    7: ("FOV", 5),
    8: ("SIMPLE_RADIAL_FISHEYE", 4),
    9: ("RADIAL_FISHEYE", 5),
    10: ("THIN_PRISM_FISHEYE", 12),
    14: ("SIMPLE_FISHEYE", 3),
    15: ("FISHEYE", 4),
}
"""Camera models by number: name and number of parameters."""
PARAMETERS = dict(MODELS.values())
_SHARED_FOCAL = (
    *("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL"),
    *("SIMPLE_FISHEYE", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE"),
)


@dataclass(frozen=True)
class ColmapImage:
    """One registered photo."""

    name: str
    camera_id: int
    world_from_camera: Float64[ndarray, "4 4"]


@dataclass(frozen=True)
class ColmapModel:
    """A reconstruction, in its own world and unit."""

    cameras: dict[int, tuple[Camera, AnyDistortion]]
    """Poses are unset."""
    images: tuple[ColmapImage, ...]
    points: ListedPoints
    listing: Path
    """The file of the photos, for messages."""


def build_colmap_camera(
    file: Path, camera_id: int, model: str, size: tuple[int, int], values: Sequence[float]
) -> tuple[Camera, AnyDistortion]:
    """Build the camera's intrinsics, without a pose, and the lens distortion of one entry.

    Raises DataError for camera models whose photos cannot be made pinhole photos here.
    """
    where = f"camera {camera_id}"
    if model not in PARAMETERS or len(values) != PARAMETERS[model]:
        problem = f"{where}: the model is {model!r} with {len(values)} parameters, which COLMAP does not know"
        raise DataError(file, problem, REMEDY)
    if model in _SHARED_FOCAL:
        values = (values[0], *values)
    intrinsics, rest = tuple(values[:4]), tuple(values[4:])
    camera = build_camera(file, where, intrinsics, size)
    if not np.isfinite(rest).all():
        raise DataError(file, f"{where}: the distortion is {rest}, expected numbers", REMEDY)
    match model:
        case "SIMPLE_PINHOLE" | "PINHOLE":
            distortion = Distortion()
        case "SIMPLE_RADIAL" | "RADIAL":
            distortion = Distortion(rest)
        case "OPENCV":
            distortion = Distortion(rest[:2], (rest[2], rest[3]))
        case "FULL_OPENCV":
            distortion = Distortion((*rest[:2], rest[4]), (rest[2], rest[3]), rest[5:])
        case "SIMPLE_FISHEYE" | "FISHEYE" | "SIMPLE_RADIAL_FISHEYE" | "RADIAL_FISHEYE" | "OPENCV_FISHEYE":
            distortion = Fisheye(rest)
        case "THIN_PRISM_FISHEYE":
            distortion = Fisheye((*rest[:2], *rest[4:6]), (rest[2], rest[3]), (rest[6], rest[7]))
        case _:
            problem = f"{where}: the model {model} is none that can be turned into a pinhole"
            raise DataError(file, problem, "Run 'colmap image_undistorter' and give its output folder")
    return camera, distortion


def invert_colmap_pose(
    file: Path, where: str, quat: Sequence[float], translation: Sequence[float]
) -> Float64[ndarray, "4 4"]:
    """Invert COLMAP's camera-from-world pose (quaternion w first). Raises DataError where it is no pose."""
    norm = math.hypot(*quat)
    if not abs(norm - 1) < 0.01 or not (np.abs(translation) < 1e9).all():
        problem = f"{where}: the pose is {[*quat]}, {[*translation]}; expected a unit quaternion and a position"
        raise DataError(file, problem, REMEDY)
    rotation = matrix_from_quaternion(np.array(quat, np.float64)).T
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, -rotation @ np.array(translation)
    return pose
