"""Folders of drivestudio's preprocessing, e.g. ``processed/training/023``.

The layout is one, its conventions are six (drivestudio's ``*_preprocess.py`` and ``*_sourceloader.py``):

| data set | camera poses | their axes | LiDAR columns | LiDAR's frame |
|---|---|---|---|---|
| Waymo | ``extrinsics/{cam}``: ego from camera | x forward, y left, z up | 14: 3 point, 11 intensity, 13 laser | ego |
| Argoverse 2, KITTI | the same | OpenCV | 4: point, intensity | ego |
| nuPlan | the same | OpenCV | 6: point, intensity, ring, laser | ego |
| PandaSet | ``extrinsics/{t}_{cam}``: world from camera | OpenCV | 5: point, intensity, laser | ego |
| nuScenes | the same | OpenCV | 4: point, intensity | ``lidar_pose`` |

Boxes are world from box with their sizes along x, y, z; x is forward but for PandaSet, where y is.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32, Float64
from numpy import ndarray

from instdrive_core.datasets.clip import Clip, ClipOptions
from instdrive_core.datasets.distortion import Distortion
from instdrive_core.datasets.photos import read_photo_size
from instdrive_core.datasets.posed_photos import build_camera
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
from instdrive_core.datasets.rig_files import (
    CAR_FROM_OPENCV,
    FORWARD_X,
    read_number_text,
    read_packed_floats,
    require_pose,
    require_sizes,
)
from instdrive_core.errors import DataError
from instdrive_core.files.json_fields import read_json, require_field, require_number
from instdrive_core.files.json_value import require_whole_text
from instdrive_core.scene.track import Track

STEP_SECONDS = 0.1
"""Between steps: the layout has no times, and its preprocessing makes 10 Hz of every data set by default."""
_PHOTO = re.compile(r"(\d{3,6})_(\d{1,2})\.(jpg|png)")
_UNREAD = ("sky_masks", "dynamic_masks", "fine_dynamic_masks", "humanpose")
_REMEDY = "Get the file again, or run drivestudio's preprocessing again"


@dataclass(frozen=True)
class _Convention:
    """How the files of one of the data sets are meant."""

    posed_photos: bool
    """Whether extrinsics are world from camera, one a photo, or ego from camera, one a camera."""
    axes: Pose
    """The extrinsics' camera from OpenCV's."""
    columns: int
    point: int
    """First column of the point."""
    intensity: int
    laser: int | None
    brightest: float
    """Intensity that counts as 1."""
    box_axes: Pose
    """The file's box from a track's."""
    car: Mapping[int, tuple[int, int]] = field(default_factory=dict)
    """By camera: rows at the bottom that show the recording car, of so many that the photos have as they were taken."""


# The rows of cars are those that drivestudio's own `data/ego_masks` cover; they are no part of a scene's folder.
_PANDASET = _Convention(True, np.eye(4), 5, 0, 3, 4, 255.0, np.eye(4), {5: (258, 1080)})
_NUSCENES = _Convention(True, np.eye(4), 4, 0, 3, None, 255.0, FORWARD_X, {5: (92, 900)})
_WAYMO = _Convention(False, CAR_FROM_OPENCV, 14, 3, 11, 13, 1.0, FORWARD_X)
_NUPLAN = _Convention(
    False, np.eye(4), 6, 0, 3, 5, 255.0, FORWARD_X, {1: (94, 1080), 2: (84, 1080), 5: (110, 1080), 6: (110, 1080)}
)
_ARGOVERSE = _Convention(
    False, np.eye(4), 4, 0, 3, None, 255.0, FORWARD_X, {0: (255, 2048), 5: (235, 1550), 6: (247, 1550)}
)
_KITTI = replace(_ARGOVERSE, brightest=1.0, car={})


def holds_drivestudio(path: str | Path) -> bool:
    """Whether the folder has photos and poses as drivestudio's preprocessing leaves them."""
    root = Path(path)
    has_poses = (root / "ego_pose").is_dir() or (root / "lidar_pose").is_dir()
    return has_poses and all((root / name).is_dir() for name in ("images", "extrinsics", "intrinsics"))


def load_drivestudio(path: str | Path, options: ClipOptions) -> Clip:
    """Open a clip that drivestudio has preprocessed.

    Raises DataError where a file is missing or damaged, OptionError for options that do not fit.
    """
    root = Path(path)
    return replace(build_recorded_clip(read_drivestudio(root), options), start_poses=_list_start_poses(root))


def read_drivestudio(root: Path) -> Recording:
    """Read poses, lenses and boxes; photos and sweeps when asked for. Raises DataError where a file is damaged."""
    listed = sorted(
        (int(match[1]), int(match[2]), file)
        for file in (root / "images").iterdir()
        if (match := _PHOTO.fullmatch(file.name))
    )
    if not listed:
        raise DataError(root / "images", "holds no photo such as 000_0.jpg", _REMEDY)
    cameras = sorted({camera for _, camera, _ in listed})
    convention = _find_convention(root, cameras)
    places = {} if convention.posed_photos else {camera: _read_place(root, camera, convention) for camera in cameras}
    frames = _list_frames(root)
    steps = sorted({step for step, _, _ in listed} | frames.keys())
    ego = {step: frames[step] for step in frames} if (root / "ego_pose").is_dir() else {}
    photos = tuple(
        RecordedPhoto(
            f"camera_{camera}",
            step,
            STEP_SECONDS * step,
            _pose_photo(root, step, camera, convention, places, frames),
            file,
            open_photo_file(file),
        )
        for step, camera, file in listed
    )
    sweeps = tuple(
        RecordedSweep(step, STEP_SECONDS * step, frames[step], partial(_load_points, file, frames[step], convention))
        for step, file in _list_sweeps(root, frames)
    )
    return Recording(
        root=root,
        name=root.resolve().name,
        lenses={f"camera_{camera}": _read_lens(root, camera, listed, convention) for camera in cameras},
        step_times={step: STEP_SECONDS * step for step in steps},
        photos=photos,
        sweeps=sweeps,
        tracks=_read_tracks(root, convention),
        world_from_ego=ego,
        notes=_describe_unread(root),
    )


def _find_convention(root: Path, cameras: list[int]) -> _Convention:
    if any(re.fullmatch(r"\d{3,6}_\d{1,2}\.txt", file.name) for file in (root / "extrinsics").iterdir()):
        return _NUSCENES if (root / "lidar_pose").is_dir() else _PANDASET
    up = [abs(_read_matrix(root / "extrinsics" / f"{camera}.txt")[2, 2]) for camera in cameras]
    if np.median(up) > 0.7:  # the third axis of the cameras points up, not forward
        return _WAYMO
    if _has_laser_columns(root):
        return _NUPLAN
    return _KITTI if len(cameras) <= 2 else _ARGOVERSE


def _has_laser_columns(root: Path) -> bool:
    """Whether sweeps have six columns, the last two of which count rings and lasers."""
    for file in sorted((root / "lidar").glob("*.bin"))[:1]:
        if file.stat().st_size % 24:
            return False
        counts = read_packed_floats(file, 6)[:, 4:]
        return bool(((counts == np.round(counts)) & (counts >= 0) & (counts < 256)).all())
    return False


def _read_matrix(file: Path) -> Pose:
    return require_pose(file, read_number_text(file, (4, 4)), "the matrix")


def _read_place(root: Path, camera: int, convention: _Convention) -> Pose:
    return _read_matrix(root / "extrinsics" / f"{camera}.txt") @ convention.axes


def _list_frames(root: Path) -> dict[int, Pose]:
    """Pose of the frame that LiDAR points are in, by step."""
    folder = next(root / name for name in ("lidar_pose", "ego_pose") if (root / name).is_dir())
    return {int(file.stem): _read_matrix(file) for file in sorted(folder.glob("*.txt")) if _is_number(file.stem)}


def _list_start_poses(root: Path) -> dict[int, Pose]:
    """World from drivestudio's own by the step it starts at: the car's pose, or nuScenes' front camera's."""
    if not (root / "lidar_pose").is_dir():
        return _list_frames(root)
    first = (file for file in sorted((root / "extrinsics").glob("*_0.txt")) if _is_number(file.stem[:-2]))
    return {int(file.stem[:-2]): _read_matrix(file) for file in first}


def _is_number(stem: str) -> bool:
    return stem.isascii() and stem.isdecimal() and len(stem) <= 6


def _pose_photo(
    root: Path, step: int, camera: int, convention: _Convention, places: dict[int, Pose], frames: dict[int, Pose]
) -> Pose:
    if convention.posed_photos:
        return _read_matrix(root / "extrinsics" / f"{step:03d}_{camera}.txt") @ convention.axes
    if step not in frames:
        problem = f"there is a photo of step {step}, yet no pose {step:03d}.txt"
        raise DataError(root / "ego_pose", problem, _REMEDY)
    return frames[step] @ places[camera]


def _read_lens(root: Path, camera: int, listed: list[tuple[int, int, Path]], convention: _Convention) -> Lens:
    file = root / "intrinsics" / f"{camera}.txt"
    fx, fy, cx, cy, k1, k2, p1, p2, k3 = map(float, read_number_text(file, (9,)))
    size = read_photo_size(next(photo for _, number, photo in listed if number == camera))
    full = build_camera(file, "the camera", (fx, fy, cx, cy), size)
    rows, height = convention.car.get(camera, (0, 0))
    hidden = rows / height if full.height == height else 0.0
    return Lens(full, Distortion((k1, k2, k3), (p1, p2)), hidden)


def _list_sweeps(root: Path, frames: dict[int, Pose]) -> list[tuple[int, Path]]:
    files = sorted(file for file in (root / "lidar").glob("*.bin") if _is_number(file.stem))
    unposed = [file.name for file in files if int(file.stem) not in frames]
    if unposed:
        raise DataError(root / "lidar", f"there is a sweep {unposed[0]} without a pose", _REMEDY)
    return [(int(file.stem), file) for file in files]


def _load_points(file: Path, frame: Pose, convention: _Convention) -> RecordedPoints:
    rows = read_packed_floats(file, convention.columns)
    points = rows[:, convention.point : convention.point + 3].astype(np.float64) @ frame[:3, :3].T + frame[:3, 3]
    intensity: Float32[ndarray, " n"] = np.clip(rows[:, convention.intensity] / convention.brightest, 0, 1)
    if convention.laser is None:
        sensor = np.zeros(len(rows), np.uint8)
    else:
        sensor = np.clip(rows[:, convention.laser], 0, 255).astype(np.uint8)
    return RecordedPoints(points, intensity.astype(np.float32), sensor)


def _read_tracks(root: Path, convention: _Convention) -> tuple[Track, ...]:
    file = root / "instances" / "instances_info.json"
    if not file.is_file():
        return ()
    content = read_json(file)
    if not isinstance(content, dict):
        raise DataError(file, "expected an object from numbers to instances", _REMEDY)
    tracks: dict[str, Track] = {}
    for number, entry in content.items():
        track = _read_track(file, number, entry, convention)
        if track is not None:
            known = track.id if track.id not in tracks else f"{track.id} ({number})"
            tracks[known] = replace(track, id=known)
    return tuple(tracks.values())


def _read_track(file: Path, number: str, entry: Any, convention: _Convention) -> Track | None:
    where = f"{number[:40]}."
    try:
        label = require_whole_text(require_field(file, entry, "class_name", where))
        known = require_whole_text(entry.get("id", number))
    except ValueError as error:
        raise DataError(file, f"{where}class_name or id cannot be used ({error})", _REMEDY) from error
    listed = require_field(file, entry, "frame_annotations", where)
    names = ("frame_idx", "obj_to_world", "box_size")
    columns = [require_field(file, listed, key, f"{where}frame_annotations.") for key in names]
    if not all(isinstance(column, list) for column in columns) or len(set(map(len, columns))) != 1:
        problem = f"{where}frame_annotations: frame_idx, obj_to_world and box_size are no lists of one length"
        raise DataError(file, problem, _REMEDY)
    poses: dict[int, Float64[ndarray, "4 4"]] = {}
    sizes = []
    for row, (step, matrix, size) in enumerate(zip(*columns, strict=True)):
        place = f"{where}frame_annotations[{row}]"
        if not isinstance(step, int) or isinstance(step, bool) or not 0 <= step < 10**6:
            raise DataError(file, f"{place}: frame_idx is {str(step)[:40]!r}, expected a time step", _REMEDY)
        pose = require_pose(file, _require_array(file, matrix, (4, 4), place), place)
        sides = _require_array(file, size, (3,), place)
        require_sizes(file, sides, place)
        poses[step] = pose @ convention.box_axes
        sizes.append(np.abs(convention.box_axes[:3, :3].T) @ sides)
    if not poses:
        return None
    steps = sorted(poses)
    times = STEP_SECONDS * np.array(steps, np.float64)
    return Track(known, label, np.median(sizes, axis=0), times, np.stack([poses[step] for step in steps]))


def _require_array(file: Path, value: Any, shape: tuple[int, ...], where: str) -> Float64[ndarray, "..."]:
    rows = value if isinstance(value, list) else []
    flat = [entry for row in rows for entry in (row if isinstance(row, list) else [row])]
    if len(rows) != shape[0] or len(flat) != int(np.prod(shape)):
        raise DataError(file, f"{where}: expected {'×'.join(map(str, shape))} numbers", _REMEDY)
    return np.array([require_number(file, entry, where) for entry in flat]).reshape(shape)


def _describe_unread(root: Path) -> tuple[str, ...]:
    unread = [name for name in _UNREAD if (root / name).is_dir()]
    spacing = f"the layout has no times: steps are taken to be {STEP_SECONDS:g} s apart"
    return (spacing, *([f"folders that are not read: {', '.join(unread)}"] if unread else []))
