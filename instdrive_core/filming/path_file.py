"""Camera paths as JSON: in a project beside its view, or in a file of their own."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from instdrive_core.errors import DataError
from instdrive_core.files.atomic import write_bytes
from instdrive_core.files.json_fields import read_json
from instdrive_core.filming.camera_path import CameraKey
from instdrive_core.scene.camera import Camera

FIELD = "camera_path"
"""Field of the file, and of a project's view, that lists the keys."""
MOST_KEYS = 1000
_LENS = ("fx", "fy", "cx", "cy", "width", "height")
_REMEDY = "In the editor, export the film along the camera path again, as .json"


def store_camera_keys(keys: Sequence[CameraKey]) -> list[dict[str, Any]]:
    """Convert keys into JSON values."""
    return [
        {
            "at": key.at,
            "time": key.time,
            "world_from_camera": key.camera.world_from_camera.tolist(),
            "lens": {name: getattr(key.camera, name) for name in _LENS},
        }
        for key in keys
    ]


def read_camera_keys(stored: object) -> tuple[CameraKey, ...]:
    """Read what `store_camera_keys` gave. Raises ValueError that names the field for anything else."""
    if not isinstance(stored, list) or len(stored) > MOST_KEYS:
        raise ValueError(f"'{FIELD}' is no list of at most {MOST_KEYS} keys")
    keys = tuple(_read_key(entry, f"{FIELD}[{number}]") for number, entry in enumerate(stored))
    for number in range(1, len(keys)):
        if keys[number].at <= keys[number - 1].at:
            raise ValueError(f"'{FIELD}[{number}].at' is {keys[number].at:g}, not later than the key before it")
    return keys


def read_camera_path(path: Path) -> tuple[CameraKey, ...]:
    """Read the keys of a file that `write_camera_path` wrote. Raises DataError where it is broken or has no key."""
    return read_stored_path(path, read_json(path))


def read_stored_path(path: Path, stored: object) -> tuple[CameraKey, ...]:
    """Read the keys of an object with the field `FIELD`, which came from the file `path`.

    Raises DataError where it is broken or has no key.
    """
    try:
        keys = read_camera_keys(stored.get(FIELD, []) if isinstance(stored, dict) else stored)
    except ValueError as error:
        raise DataError(path, f"holds no camera path: {error}", _REMEDY) from error
    if not keys:
        raise DataError(path, f"'{FIELD}' has no key", _REMEDY)
    return keys


def write_camera_path(path: Path, keys: Sequence[CameraKey]) -> None:
    """Write keys into a file of their own, atomically. Raises DataError where it cannot be written."""
    write_bytes(path, (json.dumps({FIELD: store_camera_keys(keys)}, indent=1) + "\n").encode())


def _read_key(entry: object, where: str) -> CameraKey:
    at, time = (_read_number(entry, name, where) for name in ("at", "time"))
    lens = _read_field(entry, "lens", where)
    fx, fy, cx, cy, width, height = (_read_number(lens, name, f"{where}.lens") for name in _LENS)
    if min(fx, fy) <= 0 or min(width, height) < 1:
        raise ValueError(f"'{where}.lens' has a focal length or a size that is not positive")
    stored: Any = _read_field(entry, "world_from_camera", where)
    try:
        pose = np.array(stored, float)
    except (TypeError, ValueError):
        pose = np.zeros(0)
    if pose.shape != (4, 4) or not np.isfinite(pose).all() or not _is_rotation(pose[:3, :3]):
        raise ValueError(f"'{where}.world_from_camera' is no rigid 4 × 4 pose")
    return CameraKey(at, time, Camera(fx, fy, cx, cy, int(width), int(height), pose))


def _is_rotation(matrix: np.ndarray) -> bool:
    return np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-3) and float(np.linalg.det(matrix)) > 0


def _read_field(entry: object, name: str, where: str) -> object:
    if not isinstance(entry, Mapping) or name not in entry:
        raise ValueError(f"'{where}.{name}' is missing")
    return entry[name]


def _read_number(entry: object, name: str, where: str) -> float:
    value = _read_field(entry, name, where)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"'{where}.{name}' is {value!r}, not a number")
    return float(value)
