"""The ``cameras.json`` that the INRIA trainer and programs after it write beside a scene: poses and focal lengths.

Each entry has ``img_name``, ``width``, ``height``, ``position``, ``rotation`` (world from camera, OpenCV axes, row by
row), ``fx`` and ``fy``; the principal point is the middle of the picture.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.datasets.distortion import Distortion
from instdrive_core.datasets.posed_photos import PosedPhoto, build_camera, resolve_inner_path
from instdrive_core.errors import DataError
from instdrive_core.files.json_fields import read_json, require_field, require_number

CAMERAS = "cameras.json"
MOST_CAMERAS = 100_000
_REMEDY = "Export the scene again, or remove the file"


def read_inria_cameras(file: Path, photos: Path) -> list[PosedPhoto]:
    """Read all cameras of a file, in the scene's own world; photos are named as files of the folder `photos`.

    Raises DataError where an entry is damaged, UntrustedDataError where a name leads out of the folder.
    """
    content = read_json(file)
    if not isinstance(content, list) or not content or len(content) > MOST_CAMERAS:
        raise DataError(file, f"is no list of 1 to {MOST_CAMERAS} cameras", _REMEDY)
    return [_read_entry(file, photos, entry, f"[{row}].") for row, entry in enumerate(content)]


def _read_entry(file: Path, photos: Path, entry: Any, where: str) -> PosedPhoto:
    def number(key: str) -> float:
        return require_number(file, require_field(file, entry, key, where), where + key)

    def numbers(key: str, count: int) -> Float64[ndarray, " n"]:
        value = require_field(file, entry, key, where)
        rows = value if isinstance(value, list) else []
        flat = [part for row in rows for part in (row if isinstance(row, list) else [row])]
        if len(flat) != count:
            raise DataError(file, f"the field '{where}{key}' holds no {count} numbers", _REMEDY)
        return np.array([require_number(file, part, where + key) for part in flat], np.float64)

    name = require_field(file, entry, "img_name", where)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = numbers("rotation", 9).reshape(3, 3), numbers("position", 3)
    turn = pose[:3, :3]
    if np.abs(turn @ turn.T - np.eye(3)).max() > 0.01 or np.linalg.det(turn) < 0 or np.abs(pose[:3, 3]).max() > 1e9:
        raise DataError(file, f"the field '{where}rotation' is no rotation, or the position is too far away", _REMEDY)
    width, height = int(number("width")), int(number("height"))
    lens = (number("fx"), number("fy"), width / 2, height / 2)
    camera = build_camera(file, where.rstrip("."), lens, (width, height))
    place = resolve_inner_path(file, photos, name)
    return PosedPhoto(str(name), place, replace(camera, world_from_camera=pose), Distortion())
