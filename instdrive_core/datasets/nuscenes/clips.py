"""Scenes of nuScenes (``nuscenes/scene-0061``) and of TIER IV's T4 format, one scene a folder.

Conventions as in nuscenes-devkit: world from car and car from sensor as quaternions wxyz and positions; cameras have
OpenCV axes, the car x forward, y left, z up; boxes are in the world, their sizes width, length, height, x forward.

A step is a photo of the front camera, key frame or not. Boxes are made at key frames, where the LiDAR met the objects,
and the cameras fire as the LiDAR sweeps past: so the sensors' times are compared after the offsets that they have in
key frames are taken away, and boxes are interpolated between key frames.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.datasets.clip import Clip, ClipOptions
from instdrive_core.datasets.distortion import Distortion
from instdrive_core.datasets.nuscenes.tables import Row, Tables
from instdrive_core.datasets.photos import read_photo_size
from instdrive_core.datasets.posed_photos import build_camera, resolve_inner_path
from instdrive_core.datasets.recorded_clips import build_recorded_clip
from instdrive_core.datasets.recording import (
    Lens,
    Pose,
    RecordedPhoto,
    RecordedPoints,
    RecordedSweep,
    Recording,
    open_photo_file,
)
from instdrive_core.datasets.rig_files import FORWARD_X, build_pose, read_packed_floats, require_pose, require_sizes
from instdrive_core.errors import DataError
from instdrive_core.files.json_fields import read_json, require_field, require_number, require_numbers
from instdrive_core.scene.track import Track

CAMERAS = ("CAM_FRONT", "CAM_FRONT_LEFT", "CAM_FRONT_RIGHT", "CAM_BACK_LEFT", "CAM_BACK_RIGHT", "CAM_BACK")
LIDARS = ("LIDAR_TOP", "LIDAR_CONCAT")
T4_TABLES = "annotation"
_SEEN = {"CAM_BACK": 80 / 900}
"""Share of the rows at the bottom of nuScenes' photos that show the car; neurad-studio cuts the same."""
_COLUMNS = 5
"""Floats of a LiDAR point: x, y, z, intensity up to 255, ring."""
_NEAR = 0.055
"""Seconds between what belongs to one step; nuScenes' photos are 83 ms apart, its sweeps 50 ms."""
_REMEDY = "Get the tables again"


@dataclass(frozen=True)
class _Layout:
    """Where a scene's files are."""

    root: Path
    """What file names are relative to."""
    tables: Path
    scene: str | None
    """Its name; None for the only one."""


@dataclass(frozen=True)
class _Reading:
    """A row of sample_data whose file is there."""

    row: Row
    time: float
    """Seconds."""
    is_key: bool
    file: Path


def holds_nuscenes(path: str | Path) -> bool:
    """Whether the folder holds nuScenes' tables, or the folder above it does and its name is that of a scene."""
    return _find_nuscenes(Path(path)) is not None


def holds_t4(path: str | Path) -> bool:
    """Whether the folder is a T4 data set."""
    return (Path(path) / T4_TABLES / "sample_data.json").is_file()


def load_nuscenes(path: str | Path, options: ClipOptions) -> Clip:
    """Open a scene of nuScenes, e.g. ``nuscenes/scene-0061``; the scene's name is no folder on disk.

    Raises DataError where a file is missing or damaged, OptionError for options that do not fit.
    """
    layout = _find_nuscenes(Path(path))
    if layout is None:
        raise DataError(path, "holds no tables of nuScenes", "Give the folder with 'v1.0-…', and the scene's name")
    return build_recorded_clip(_read_scene(Path(path), layout), options)


def load_t4(path: str | Path, options: ClipOptions) -> Clip:
    """Open a T4 data set. Raises DataError for damaged files, OptionError for options that do not fit."""
    root = Path(path)
    return build_recorded_clip(_read_scene(root, _Layout(root, root / T4_TABLES, None)), options)


def _find_nuscenes(path: Path) -> _Layout | None:
    for root, scene in ((path, None), (path.parent, path.name)):
        if scene is not None and path.exists():
            return None
        found = sorted(folder for folder in root.glob("v1.0-*") if (folder / "sample_data.json").is_file())
        if found:
            return _Layout(root, _choose_version(found, scene), scene)
    return None


def _choose_version(found: list[Path], scene: str | None) -> Path:
    """The first version that has the scene: nuScenes may lie there as 'mini' and as 'trainval'."""
    for folder in found if scene is not None and len(found) > 1 else ():
        if any(row.get("name") == scene for row in Tables(folder).rows("scene")):
            return folder
    return found[0]


def _read_scene(path: Path, layout: _Layout) -> Recording:
    tables = Tables(layout.tables)
    scene = _find_scene(tables, layout)
    samples = tables.having("sample", "scene_token", [tables.text("scene", scene, "token")])
    moments = {
        tables.text("sample", row, "token"): tables.integer("sample", row, "timestamp") * 1e-6 for row in samples
    }
    readings, missing = _list_readings(tables, layout, moments)
    cameras = [name for name in _order_cameras(readings) if readings[name]]
    if not cameras:
        raise DataError(layout.root, "holds no photo of the scene", "Get its files ('samples', 'sweeps'), too")
    lidar = next(
        (name for name in (*LIDARS, *sorted(readings)) if name.startswith("LIDAR") and readings.get(name)), None
    )
    offsets = {name: _measure_offset(readings[name], moments, tables) for name in readings}
    steps = [reading.time - offsets[cameras[0]] for reading in readings[cameras[0]]]
    if any(later <= earlier for earlier, later in pairwise(steps)):
        raise DataError(tables.file("sample_data"), f"the times of {cameras[0]} do not rise", _REMEDY)
    photos = [
        _build_photo(tables, name, step, reading)
        for name in cameras
        for step, reading in _match(readings[name], offsets[name], steps)
    ]
    sweeps = _match(readings[lidar], offsets[lidar], steps) if lidar else []
    return Recording(
        root=path,
        name=layout.scene or tables.text("scene", scene, "name"),
        lenses={name: _read_lens(tables, name, readings[name][0]) for name in cameras},
        step_times=dict(enumerate(steps)),
        photos=tuple(photos),
        sweeps=tuple(_build_sweep(tables, layout, step, steps[step], reading) for step, reading in sweeps),
        tracks=_read_tracks(tables, moments),
        world_from_ego={step: _read_car(tables, reading.row) for step, reading in enumerate(readings[cameras[0]])},
        notes=(f"{missing} files that the tables name are missing",) if missing else (),
    )


def _find_scene(tables: Tables, layout: _Layout) -> Row:
    scenes = {tables.text("scene", row, "name"): row for row in tables.rows("scene")}
    if layout.scene is None and len(scenes) == 1:
        return next(iter(scenes.values()))
    if layout.scene in scenes:
        return scenes[layout.scene]
    some = ", ".join(sorted(scenes)[:8]) + (", …" if len(scenes) > 8 else "")
    problem = "holds several scenes" if layout.scene is None else f"has no scene '{layout.scene}'"
    raise DataError(
        layout.tables, problem, f"Give the folder and a scene's name, e.g. {layout.root}/NAME. There are {some}"
    )


def _list_readings(tables: Tables, layout: _Layout, moments: dict[str, float]) -> tuple[dict[str, list[_Reading]], int]:
    """What each sensor recorded of a scene, by time, and how many of the files are missing."""
    found: dict[str, dict[float, _Reading]] = {}
    missing = 0
    for row in tables.having("sample_data", "sample_token", moments):
        mount = tables.follow("sample_data", row, "calibrated_sensor")
        sensor = tables.follow("calibrated_sensor", mount, "sensor")
        name = tables.text("sensor", sensor, "channel")
        if sensor.get("modality") not in ("camera", "lidar") or row.get("is_valid") is False:
            continue
        file = resolve_inner_path(tables.file("sample_data"), layout.root, row.get("filename"))
        time = tables.integer("sample_data", row, "timestamp") * 1e-6
        if file.is_file():
            found.setdefault(name, {})[time] = _Reading(row, time, row.get("is_key_frame") is True, file)
        else:
            missing += 1
    return {name: [readings[time] for time in sorted(readings)] for name, readings in found.items()}, missing


def _order_cameras(readings: dict[str, list[_Reading]]) -> list[str]:
    """The known cameras, then all others; sensors that are no cameras have no photo."""
    others = [name for name in sorted(readings) if name not in CAMERAS and name.startswith("CAM")]
    front = sorted((name for name in others if "FRONT" in name), key=len)
    return [*(name for name in CAMERAS if name in readings), *front, *(n for n in others if n not in front)]


def _measure_offset(readings: list[_Reading], moments: dict[str, float], tables: Tables) -> float:
    """Seconds by which a sensor's key frames are later than their samples."""
    late = [
        reading.time - moments[tables.text("sample_data", reading.row, "sample_token")]
        for reading in readings
        if reading.is_key
    ]
    return float(np.clip(np.median(late), -0.2, 0.2)) if late else 0.0


def _match(readings: list[_Reading], offset: float, steps: list[float]) -> list[tuple[int, _Reading]]:
    """Pairs of a step and the sensor's reading nearest to it."""
    times = np.array([reading.time - offset for reading in readings])
    nearest = [int(np.argmin(np.abs(times - step))) for step in steps] if len(times) else []
    return [(step, readings[place]) for step, place in enumerate(nearest) if abs(times[place] - steps[step]) <= _NEAR]


def _read_car(tables: Tables, row: Row) -> Pose:
    """World from car."""
    pose = tables.follow("sample_data", row, "ego_pose")
    return build_pose(
        tables.file("ego_pose"), pose.get("rotation"), pose.get("translation"), str(pose.get("token"))[:60]
    )


def _place_sensor(tables: Tables, row: Row) -> Pose:
    """World from sensor."""
    mount = tables.follow("sample_data", row, "calibrated_sensor")
    where = str(mount.get("token"))[:60]
    placed = build_pose(tables.file("calibrated_sensor"), mount.get("rotation"), mount.get("translation"), where)
    return _read_car(tables, row) @ placed


def _build_photo(tables: Tables, name: str, step: int, reading: _Reading) -> RecordedPhoto:
    pose = _place_sensor(tables, reading.row)
    return RecordedPhoto(name, step, reading.time, pose, reading.file, open_photo_file(reading.file))


def _build_sweep(tables: Tables, layout: _Layout, step: int, time: float, reading: _Reading) -> RecordedSweep:
    pose = _place_sensor(tables, reading.row)
    columns = _count_columns(tables, layout, reading.row)
    return RecordedSweep(step, time, pose, partial(_load_points, reading.file, columns, pose))


def _count_columns(tables: Tables, layout: _Layout, row: Row) -> int:
    """Floats of a point: five, unless T4 says otherwise in a file of its own."""
    name = row.get("info_filename")
    file = None if not name else resolve_inner_path(tables.file("sample_data"), layout.root, name)
    if file is None or not file.is_file():
        return _COLUMNS
    count = require_number(file, require_field(file, read_json(file), "num_pts_feats"), "num_pts_feats")
    if count != int(count) or not 4 <= count <= 64:
        raise DataError(file, f"the field 'num_pts_feats' is {count:g}, expected 4 to 64", _REMEDY)
    return int(count)


def _load_points(file: Path, columns: int, world_from_lidar: Pose) -> RecordedPoints:
    if file.suffix == ".pcd":
        raise DataError(file, "is a .pcd file; of T4's sweeps only '.pcd.bin' is read", "Convert the sweeps")
    rows = read_packed_floats(file, columns)
    points = rows[:, :3].astype(np.float64) @ world_from_lidar[:3, :3].T + world_from_lidar[:3, 3]
    return RecordedPoints(points, np.clip(rows[:, 3] / 255, 0, 1), np.zeros(len(rows), np.uint8))


def _read_lens(tables: Tables, name: str, reading: _Reading) -> Lens:
    file = tables.file("calibrated_sensor")
    mount = tables.follow("sample_data", reading.row, "calibrated_sensor")
    where = str(mount.get("token"))[:60]
    rows = mount.get("camera_intrinsic")
    if not isinstance(rows, list) or len(rows) != 3 or any(not isinstance(r, list) or len(r) != 3 for r in rows):
        raise DataError(file, f"{where}.camera_intrinsic is no matrix of 3×3 numbers", _REMEDY)
    matrix = np.array([[require_number(file, value, f"{where}.camera_intrinsic") for value in row] for row in rows])
    intrinsics = (float(matrix[0, 0]), float(matrix[1, 1]), float(matrix[0, 2]), float(matrix[1, 2]))
    camera = build_camera(file, where, intrinsics, read_photo_size(reading.file))
    hidden = _SEEN.get(name, 0.0) if (camera.width, camera.height) == (1600, 900) else 0.0
    return Lens(camera, _read_distortion(file, where, mount.get("camera_distortion") or []), hidden)


def _read_distortion(file: Path, where: str, value: object) -> Distortion:
    """T4's coefficients, which are in OpenCV's order."""
    k = require_numbers(file, value, f"{where}.camera_distortion")
    if (len(k) not in (0, 4, 5, 8) and any(k[8:])) or len(k) in (1, 2, 3, 6, 7):
        problem = f"{where}.camera_distortion has {len(k)} coefficients; 4, 5 and 8 are known, or zeros after the 8th"
        raise DataError(file, problem, "Rectify the photos first")
    k += [0.0] * (8 - len(k))
    return Distortion((k[0], k[1], k[4]), (k[2], k[3]), (k[5], k[6], k[7]))


def _read_tracks(tables: Tables, moments: dict[str, float]) -> tuple[Track, ...]:
    boxes: dict[str, dict[float, tuple[Pose, Float64[ndarray, "3"]]]] = {}
    if not tables.file("sample_annotation").is_file():
        return ()
    file = tables.file("sample_annotation")
    for row in tables.having("sample_annotation", "sample_token", moments):
        where = str(row.get("token"))[:60]
        sizes = np.array(require_numbers(file, row.get("size"), f"{where}.size"))
        if len(sizes) != 3:
            raise DataError(file, f"{where}.size has {len(sizes)} numbers, expected width, length, height", _REMEDY)
        require_sizes(file, sizes, where)
        pose = build_pose(file, row.get("rotation"), row.get("translation"), where) @ FORWARD_X
        time = moments[row["sample_token"]]
        known = tables.text("sample_annotation", row, "instance_token")
        boxes.setdefault(known, {})[time] = require_pose(file, pose, where), sizes
    return tuple(_build_track(tables, known, found) for known, found in boxes.items())


def _build_track(tables: Tables, known: str, found: dict[float, tuple[Pose, Float64[ndarray, "3"]]]) -> Track:
    instance = tables.find("instance", known, "sample_annotation")
    label = tables.text("category", tables.follow("instance", instance, "category"), "name")
    times = sorted(found)
    dimensions = np.median([found[time][1] for time in times], axis=0)
    return Track(known, label, dimensions, np.array(times), np.stack([found[time][0] for time in times]))
