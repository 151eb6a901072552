"""Folders of INRIA's trainer: ``cfg_args``, ``cameras.json`` and ``point_cloud/iteration_N/point_cloud.ply``.

The newest iteration is opened, with the cameras of the photos (Kerbl et al. 2023, ``utils/camera_utils.py``: position
and rotation are world_from_camera, axes x right, y down, z forward). Trainers that grew out of it write the same.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from instdrive_core.errors import DataError
from instdrive_core.files.json_fields import read_json, require_field, require_number, require_numbers
from instdrive_core.files.plain_file import require_plain_file
from instdrive_core.formats.allocation import WHOLE, ReadOptions
from instdrive_core.formats.ply.inria import read_ply
from instdrive_core.formats.scene_format import FolderLayout, Format
from instdrive_core.scene.camera import Camera, CameraView
from instdrive_core.scene.scene import Scene

_CAMERAS, _SETTINGS, _POINTS, _PLY = "cameras.json", "cfg_args", "point_cloud", "point_cloud.ply"
_ITERATION = re.compile(r"iteration_(\d{1,9})")
_ENDINGS = ("", ".jpg", ".png", ".JPG", ".jpeg", ".PNG")
_MAX_SETTINGS, _MAX_SIZE = 1 << 20, 1 << 17
_OPEN_PLY = f"Copy the folder whole, or open its {_PLY} itself, which has no cameras"
_REMEDY = f"Take the file as the trainer has written it, or open the folder's {_PLY} itself, which has no cameras"


def read_training_folder(path: Path, options: ReadOptions = WHOLE) -> Scene:
    """Open the newest iteration of a folder, or of that which a ``cfg_args`` is in. Raises DataError."""
    points, cameras, settings = _list_files(path)
    photos = _find_photos(settings)
    scene = read_ply(points, options)
    left_out = scene.left_out
    if (settings.parent / "exposure.json").is_file():
        left_out = (*left_out, "exposures of the photos (exposure.json): the splats' own colours are drawn")
    return replace(scene, views=_read_views(cameras, photos), left_out=left_out)


def _read_views(path: Path, photos: tuple[Path, ...]) -> tuple[CameraView, ...]:
    entries = read_json(path)
    if not isinstance(entries, list):
        raise DataError(path, f"it holds a {type(entries).__name__}, not a list of cameras", _REMEDY)
    return tuple(_read_view(path, entry, number, photos) for number, entry in enumerate(entries))


def _read_view(path: Path, entry: Any, number: int, photos: tuple[Path, ...]) -> CameraView:
    where = f"[{number}]."
    width, height, fx, fy = (
        require_number(path, require_field(path, entry, name, where), f"{where}{name}")
        for name in ("width", "height", "fx", "fy")
    )
    sizes_fit = all(1 <= size <= _MAX_SIZE and size == int(size) for size in (width, height))
    if not (sizes_fit and 0 < fx < 1e9 and 0 < fy < 1e9):
        raise DataError(path, f"{where}width, height, fx or fy is no size of a photo or no focal length", _REMEDY)
    position = require_numbers(path, require_field(path, entry, "position", where), f"{where}position")
    rows = require_field(path, entry, "rotation", where)
    rotation = [require_numbers(path, row, f"{where}rotation") for row in rows] if isinstance(rows, list) else []
    if len(position) != 3 or [len(row) for row in rotation] != [3, 3, 3] or max(map(abs, position)) > 1e12:
        raise DataError(path, f"{where}position is no place, or {where}rotation no matrix of 3 x 3", _REMEDY)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, position
    if np.abs(rotation).max() > 2 or not np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-3):
        raise DataError(path, f"{where}rotation does more than turn", _REMEDY)
    name = require_field(path, entry, "img_name", where)
    if not isinstance(name, str) or not name.isprintable():
        raise DataError(path, f"{where}img_name is no text", _REMEDY)
    camera = Camera(fx, fy, width / 2, height / 2, int(width), int(height), pose)
    return CameraView(camera, "camera", number, float(number), _find_photo(name, photos))


def _find_photos(path: Path) -> tuple[Path, ...]:
    """Folders in which the photos may lie, by the trainer's settings. Raises DataError where they are not whole."""
    try:
        with require_plain_file(path).open("rb") as file:
            settings = file.read(_MAX_SETTINGS).decode().strip()
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(path, f"the trainer's settings cannot be read ({error})", _OPEN_PLY) from error
    if not (settings.startswith("Namespace(") and settings.endswith(")")):
        raise DataError(path, "the trainer's settings are no whole 'Namespace(…)'", _OPEN_PLY)
    found = dict(re.findall(r"(source_path|images)='([^'\n]{1,1000})'", settings))
    source = Path(found.get("source_path", ""))
    return (source / found.get("images", "images"), source) if found.get("source_path") else ()


def _find_photo(name: str, folders: tuple[Path, ...]) -> str:
    """The photo's path; empty where there is none, or its name leads out of the folder."""
    if not name or "\0" in name or ".." in Path(name).parts or Path(name).is_absolute() or len(name) > 200:
        return ""
    for folder in folders:
        for ending in _ENDINGS:
            try:
                if (folder / f"{name}{ending}").is_file():
                    return str((folder / f"{name}{ending}").absolute())
            except (OSError, ValueError):
                continue
    return ""


def _find_iterations(path: Path) -> list[tuple[int, Path]]:
    try:
        folders = list((path / _POINTS).iterdir())
    except OSError:
        return []
    found = [(int(match[1]), folder / _PLY) for folder in folders if (match := _ITERATION.fullmatch(folder.name))]
    return sorted((number, file) for number, file in found if file.is_file())


def _holds_training(path: Path) -> bool:
    return path.is_dir() and bool(_find_iterations(path))


def _list_files(path: Path) -> tuple[Path, ...]:
    """The newest .ply, the cameras and the settings. Raises DataError where one of them is missing."""
    folder = path if path.is_dir() else path.parent
    iterations = _find_iterations(folder)
    if not iterations:
        raise DataError(folder / _POINTS, f"it holds no iteration_N/{_PLY}", "Train, or copy the folder whole")
    for name in (_CAMERAS, _SETTINGS):
        if not (folder / name).is_file():
            raise DataError(folder, f"the folder holds no {name}", _OPEN_PLY)
    return iterations[-1][1], folder / _CAMERAS, folder / _SETTINGS


TRAINING_FOLDER = Format(
    "Training folder of INRIA's 3D Gaussian Splatting",
    _SETTINGS,
    read_training_folder,
    folder=FolderLayout(_holds_training, _list_files),
    in_world_of_photos=True,
)
