"""Folders with nerfstudio's ``transforms.json``: poses in OpenGL axes, intrinsics for all photos or for each.

Fields after nerfstudio's page on its data format; ``ply_file_path`` names a point cloud in the same world.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.datasets.clip import Clip, ClipOptions
from instdrive_core.datasets.distortion import AnyDistortion, Distortion
from instdrive_core.datasets.fisheye import Fisheye
from instdrive_core.datasets.photos import read_photo_size
from instdrive_core.datasets.point_cloud import read_point_ply
from instdrive_core.datasets.posed_photos import (
    ListedPoints,
    PosedPhoto,
    build_camera,
    build_photo_clip,
    resolve_inner_path,
)
from instdrive_core.errors import DataError
from instdrive_core.files.json_fields import read_json, require_field, require_number
from instdrive_core.scene.camera import Camera

LISTING = "transforms.json"
_REMEDY = "Export the data set again, or correct the file"
_SUFFIXES = ("", ".png", ".jpg", ".jpeg")
"""Tried in turn: files of the first NeRFs name photos without."""
_PINHOLES = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")
_FISHEYES = ("OPENCV_FISHEYE", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE")
_IGNORED = ("mask_path", "depth_file_path", "train_filenames", "val_filenames", "test_filenames")
"""Fields that say something about photos which a clip has no place for."""
_FROM_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])


def holds_nerfstudio(path: str | Path) -> bool:
    """Whether the folder holds a ``transforms.json``."""
    return (Path(path) / LISTING).is_file()


def load_nerfstudio(path: str | Path, options: ClipOptions) -> Clip:
    """Open a folder with a ``transforms.json``: a static clip; photos that are missing are left out.

    Raises DataError where the file is damaged or no photo is there, UntrustedDataError where a path leads out of the
    folder, OptionError for options that do not fit.
    """
    root, listing = Path(path), Path(path) / LISTING
    content = read_json(listing)
    photos = _read_photos(root, content)
    return build_photo_clip(root, listing, photos, _read_points(root, content), options, _describe_ignored(content))


def list_nerfstudio_photos(root: Path) -> list[PosedPhoto]:
    """List the photos of a folder with a ``transforms.json``, in the file's own world. Raises as `load_nerfstudio`."""
    return _read_photos(root, read_json(root / LISTING))


def _read_photos(root: Path, content: Any) -> list[PosedPhoto]:
    listing = root / LISTING
    frames = require_field(listing, content, "frames")
    if not isinstance(frames, list):
        problem = f"the field 'frames' is a {type(frames).__name__}, expected a list"
        raise DataError(listing, problem, _REMEDY)
    return [_read_photo(root, content, frame, f"frames[{row}].") for row, frame in enumerate(frames)]


def _describe_ignored(content: dict[str, Any]) -> tuple[str, ...]:
    """A note on fields that are there but not read."""
    fields = dict.fromkeys(key for entry in (content, *content["frames"]) for key in entry)
    ignored = [key for key in fields if key in _IGNORED]
    return (f"fields that are not read: {', '.join(ignored)}",) if ignored else ()


def _read_photo(root: Path, content: dict[str, Any], frame: Any, where: str) -> PosedPhoto:
    listing = root / LISTING
    name = require_field(listing, frame, "file_path", where)
    file = resolve_inner_path(listing, root, name)
    file = next((other for suffix in _SUFFIXES if (other := file.with_name(file.name + suffix)).is_file()), file)
    camera, distortion = _read_camera(listing, content | frame, file, where)
    pose = _read_pose(listing, require_field(listing, frame, "transform_matrix", where), f"{where}transform_matrix")
    return PosedPhoto(file.relative_to(root).as_posix(), file, replace(camera, world_from_camera=pose), distortion)


def _read_camera(listing: Path, known: dict[str, Any], file: Path, where: str) -> tuple[Camera, AnyDistortion]:
    """Intrinsics of a photo from its own fields, else those of all.

    The size is the photo's where none is given; a missing photo, which nobody will see, counts as one pixel.
    """
    model = known.get("camera_model", "OPENCV")
    if model not in (*_PINHOLES, *_FISHEYES):
        problem = f"the field 'camera_model' is {model!r}, expected one of {', '.join((*_PINHOLES, *_FISHEYES))}"
        raise DataError(listing, problem, "Make pinhole photos of them first, e.g. with nerfstudio's ns-process-data")

    def value(key: str, default: float | None = None) -> float:
        found = known.get(key, default)
        return require_number(
            listing, require_field(listing, known, key, where) if found is None else found, where + key
        )

    if {"w", "h"} <= known.keys():
        width, height = value("w"), value("h")
    else:
        width, height = read_photo_size(file) if file.is_file() else (1, 1)
    if width != int(width) or height != int(height):
        raise DataError(listing, f"{where}w, h are {width}, {height}, expected whole numbers", _REMEDY)

    def focal_length(axis: str, pixels: float, default: float | None) -> float:
        if f"fl_{axis}" in known or f"camera_angle_{axis}" not in known:
            return value(f"fl_{axis}", default)
        return _compute_focal_length(listing, f"{where}camera_angle_{axis}", value(f"camera_angle_{axis}"), pixels)

    fx = focal_length("x", width, None)
    intrinsics = (fx, focal_length("y", height, fx), value("cx", width / 2), value("cy", height / 2))
    radial = tuple(value(f"k{order}", 0) for order in range(1, 5))
    is_fisheye = model in _FISHEYES
    distortion = Fisheye(radial) if is_fisheye else Distortion(radial, (value("p1", 0), value("p2", 0)))
    return build_camera(listing, where.rstrip("."), intrinsics, (int(width), int(height))), distortion


def _compute_focal_length(listing: Path, name: str, angle: float, pixels: float) -> float:
    if not 0 < angle < math.pi:
        raise DataError(listing, f"the field '{name}' is {angle}, expected radians between 0 and π", _REMEDY)
    return pixels / 2 / math.tan(angle / 2)


def _read_pose(listing: Path, value: Any, name: str) -> Float64[ndarray, "4 4"]:
    """World from camera in OpenCV axes."""
    rows = value if isinstance(value, list) else []
    if len(rows) not in (3, 4) or any(not isinstance(row, list) or len(row) != 4 for row in rows):
        raise DataError(listing, f"the field '{name}' is no matrix of 4×4 or 3×4 numbers", _REMEDY)
    pose = np.eye(4)
    pose[: len(rows)] = [[require_number(listing, entry, name) for entry in row] for row in rows]
    rotation = pose[:3, :3]
    is_rigid = np.abs(rotation).max() < 2 and np.abs(rotation @ rotation.T - np.eye(3)).max() < 0.01
    if not is_rigid or np.linalg.det(rotation) < 0 or np.abs(pose[:3, 3]).max() >= 1e9:
        problem = f"the field '{name}' is no rotation and position: {pose.tolist()}"
        raise DataError(listing, problem, _REMEDY)
    left, _, right = np.linalg.svd(rotation)
    pose[:3, :3], pose[3] = left @ right, (0, 0, 0, 1)
    return pose @ _FROM_OPENGL


def _read_points(root: Path, content: dict[str, Any]) -> ListedPoints:
    name = content.get("ply_file_path")
    if name is None:
        return ListedPoints.none()
    file = resolve_inner_path(root / LISTING, root, name)
    if not file.is_file():
        problem = f"the field 'ply_file_path' names {name!r}, which is missing"
        raise DataError(root / LISTING, problem, "Put the file there, or remove the field to start from random points")
    return read_point_ply(file)
