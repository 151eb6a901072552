"""COLMAP's binary model files. Every count is held against the bytes that are left before anything is made by it."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np

from instdrive_core.datasets.colmap.model import MODELS, REMEDY, ColmapImage, build_colmap_camera, invert_colmap_pose
from instdrive_core.datasets.distortion import AnyDistortion
from instdrive_core.datasets.posed_photos import ListedPoints, check_points
from instdrive_core.errors import DataError
from instdrive_core.files.plain_file import require_plain_file
from instdrive_core.scene.camera import Camera

_COUNT = struct.Struct("<Q")
_CAMERA = struct.Struct("<IiQQ")
_IMAGE = struct.Struct("<I7dI")
_OBSERVATION_BYTES = 24
_POINT = struct.Struct("<Q3d3BdQ")
_TRACK_BYTES = 8
_MAX_NAME = 4096


def read_cameras(file: Path) -> dict[int, tuple[Camera, AnyDistortion]]:
    """``cameras.bin``. Raises DataError where anything about it is wrong."""
    reader, cameras = _Reader(file), {}
    for _ in range(reader.read_count("cameras", _CAMERA.size)):
        camera_id, model, width, height = reader.take(_CAMERA)
        if model not in MODELS:
            raise DataError(file, f"camera {camera_id}: COLMAP knows no camera model {model}", REMEDY)
        name, parameters = MODELS[model]
        values = reader.take(struct.Struct(f"<{parameters}d"))
        cameras[camera_id] = build_colmap_camera(file, camera_id, name, (width, height), values)
    reader.check_end()
    return cameras


def read_images(file: Path) -> tuple[ColmapImage, ...]:
    """``images.bin`` without its observations. Raises DataError where anything about it is wrong."""
    reader, images = _Reader(file), []
    for _ in range(reader.read_count("images", _IMAGE.size + 1 + _COUNT.size)):
        image_id, *pose, camera_id = reader.take(_IMAGE)
        name = reader.read_name()
        reader.skip(reader.read_count(f"observations of image {image_id}", _OBSERVATION_BYTES) * _OBSERVATION_BYTES)
        where = f"image {image_id} ({name})"
        images.append(ColmapImage(name, camera_id, invert_colmap_pose(file, where, pose[:4], pose[4:])))
    reader.check_end()
    return tuple(images)


def read_points(file: Path) -> ListedPoints:
    """``points3D.bin`` without its tracks. Raises DataError where anything about it is wrong."""
    reader = _Reader(file)
    count = reader.read_count("points", _POINT.size)
    points, colors = np.zeros((count, 3)), np.zeros((count, 3), np.uint8)
    for row in range(count):
        _, x, y, z, red, green, blue, _, length = reader.take(_POINT)
        points[row], colors[row] = (x, y, z), (red, green, blue)
        reader.skip(reader.check_count(length, f"views of point {row}", _TRACK_BYTES) * _TRACK_BYTES)
    reader.check_end()
    check_points(file, points)
    return ListedPoints(points, colors)


class _Reader:
    """A file's bytes and how far they are read."""

    def __init__(self, file: Path) -> None:
        self.file, self.position = file, 0
        try:
            self.data = require_plain_file(file).read_bytes()
        except OSError as error:
            raise DataError(file, f"cannot be read ({error})", REMEDY) from error

    def take(self, layout: struct.Struct) -> tuple[Any, ...]:
        start = self.position
        self.skip(layout.size)
        return layout.unpack_from(self.data, start)

    def skip(self, size: int) -> None:
        if self.position + size > len(self.data):
            problem = f"ends after {len(self.data)} bytes, at least {self.position + size} are needed"
            raise DataError(self.file, problem, REMEDY)
        self.position += size

    def read_count(self, what: str, least_bytes: int) -> int:
        return self.check_count(self.take(_COUNT)[0], what, least_bytes)

    def check_count(self, count: int, what: str, least_bytes: int) -> int:
        left = len(self.data) - self.position
        if count * least_bytes > left:
            problem = f"promises {count} {what}, at least {count * least_bytes} bytes; {left} are left"
            raise DataError(self.file, problem, REMEDY)
        return count

    def read_name(self) -> str:
        end = self.data.find(b"\0", self.position, self.position + _MAX_NAME)
        if end < 0:
            raise DataError(self.file, f"the name at byte {self.position} does not end", REMEDY)
        name = self.data[self.position : end].decode("utf-8", errors="replace")
        self.position = end + 1
        return name

    def check_end(self) -> None:
        left = len(self.data) - self.position
        if left:
            raise DataError(self.file, f"{left} bytes follow what its counts promise", REMEDY)
