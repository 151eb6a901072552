"""Sequences of KITTI's tracking benchmark, opened by their photos: ``training/image_02/0004``.

What belongs to them lies beside ``image_02``: ``image_03``, ``velodyne``, ``oxts``, ``calib`` and ``label_02``. Labels
are boxes in the rectified axes of camera 0 (x right, y down, z forward): the bottom's centre and a turn about y.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.datasets.clip import Clip, ClipOptions
from instdrive_core.datasets.kitti.numbers import (
    pose_from_oxts,
    read_named_numbers,
    require_matrix,
    require_rotation,
    require_transform,
)
from instdrive_core.datasets.kitti.rig import COLOR_CAMERAS, KittiRig, list_counted_files, list_photos, list_sweeps
from instdrive_core.datasets.recorded_clips import build_recorded_clip
from instdrive_core.datasets.recording import Pose, Recording
from instdrive_core.datasets.rig_files import invert_pose, parse_numbers, require_sizes
from instdrive_core.errors import DataError
from instdrive_core.files.json_value import require_whole_text
from instdrive_core.files.text_file import read_text
from instdrive_core.scene.track import Track

STEP_SECONDS = 0.1
"""Between steps: the benchmark has no times; KITTI's LiDAR turns ten times a second."""
_REMEDY = "Get the file again"
_LABEL_FIELDS = 17


def holds_kitti_tracking(path: str | Path) -> bool:
    """Whether the folder holds the photos of a sequence whose calibration lies where the benchmark has it."""
    root = Path(path).resolve()
    return root.parent.name in COLOR_CAMERAS and (root.parents[1] / "calib" / f"{root.name}.txt").is_file()


def load_kitti_tracking(path: str | Path, options: ClipOptions) -> Clip:
    """Open a sequence of KITTI's tracking benchmark.

    Raises DataError where a file is missing or damaged, OptionError for options that do not fit.
    """
    return build_recorded_clip(read_kitti_tracking(Path(path)), options)


def read_kitti_tracking(root: Path) -> Recording:
    """Read poses, lenses and boxes of a sequence; photos and sweeps when asked for."""
    benchmark, name = root.resolve().parents[1], root.resolve().name
    listed = {camera: list_counted_files(benchmark / camera / name, ".png") for camera in COLOR_CAMERAS}
    cameras = {camera: files for camera, files in listed.items() if files}
    if not cameras:
        raise DataError(root, "holds no photo such as 000000.png", "Get the sequence's photos")
    rig = _read_rig(benchmark / "calib" / f"{name}.txt", list(cameras))
    poses = _read_poses(benchmark / "oxts" / f"{name}.txt")
    times = {step: STEP_SECONDS * step for step in poses}
    labels = benchmark / "label_02" / f"{name}.txt"
    axes = rig.imu_from_velodyne @ invert_pose(rig.rectified_from_velodyne)
    frames = {step: pose @ axes for step, pose in poses.items()}
    return Recording(
        root=root,
        name=name,
        lenses={camera: rig.build_lens(camera, next(iter(files.values()))) for camera, files in cameras.items()},
        step_times=times,
        photos=list_photos(rig, cameras, poses, times),
        sweeps=list_sweeps(
            list_counted_files(benchmark / "velodyne" / name, ".bin"), poses, rig.imu_from_velodyne, times
        ),
        tracks=_read_tracks(labels, frames) if labels.is_file() else (),
        world_from_ego=poses,
        notes=(f"the benchmark has no times: steps are taken to be {STEP_SECONDS:g} s apart",),
    )


def _read_rig(file: Path, cameras: list[str]) -> KittiRig:
    found = read_named_numbers(file)
    rectified = require_rotation(file, found, ("R_rect", "R0_rect"))
    velodyne = require_transform(file, found, ("Tr_velo_cam", "Tr_velo_to_cam"))
    imu = require_transform(file, found, ("Tr_imu_velo", "Tr_imu_to_velo"))
    projections = {name: require_matrix(file, found, (f"P{int(name[-2:])}",), (3, 4)) for name in cameras}
    return KittiRig(file, invert_pose(imu), rectified @ velodyne, projections)


def _read_poses(file: Path) -> dict[int, Pose]:
    rows = [
        parse_numbers(file, line.split(), f"line {row + 1}")
        for row, line in enumerate(read_text(file).splitlines())
        if line.strip()
    ]
    if not rows or not len(rows[0]):
        raise DataError(file, "holds no pose", "Get the benchmark's 'oxts', too")
    scale = float(np.cos(np.radians(rows[0][0])))
    return {step: pose_from_oxts(file, values, scale) for step, values in enumerate(rows)}


def _read_tracks(file: Path, frames: dict[int, Pose]) -> tuple[Track, ...]:
    found: dict[str, dict[int, tuple[Pose, Float64[ndarray, "3"]]]] = {}
    labels: dict[str, str] = {}
    for row, line in enumerate(read_text(file).splitlines()):
        words, where = line.split(), f"line {row + 1}"
        if not words or (len(words) > 2 and words[2] == "DontCare"):
            continue
        if len(words) < _LABEL_FIELDS:
            raise DataError(file, f"{where} has {len(words)} fields, expected {_LABEL_FIELDS}", _REMEDY)
        numbers = parse_numbers(file, [words[0], words[1], *words[10:_LABEL_FIELDS]], where)
        step, height, width, length = int(numbers[0]), *numbers[2:5]
        if step != numbers[0] or step not in frames:
            raise DataError(file, f"{where}: there is no pose of step {words[0][:20]}", _REMEDY)
        sizes = np.array([width, length, height])
        require_sizes(file, sizes, where)
        known = words[1]
        labels.setdefault(known, require_whole_text(words[2]))
        box = place_camera_box(numbers[5:8], float(numbers[8]), float(height))
        found.setdefault(known, {})[step] = (frames[step] @ box, sizes)
    return tuple(_build_track(known, labels[known], found[known]) for known in found)


def place_camera_box(bottom: Float64[ndarray, "3"], turn: float, height: float) -> Pose:
    """Place a track's box (y forward, z up) in a camera's axes: its bottom's centre, its turn about the camera's y."""
    pose = np.eye(4)
    forward, up = np.array([np.cos(turn), 0, -np.sin(turn)]), np.array([0.0, -1, 0])
    pose[:3, :3] = np.stack([np.cross(forward, up), forward, up], axis=1)
    pose[:3, 3] = bottom + up * height / 2
    return pose


def _build_track(known: str, label: str, boxes: dict[int, tuple[Pose, Float64[ndarray, "3"]]]) -> Track:
    steps = sorted(boxes)
    return Track(
        known,
        label,
        np.median([boxes[step][1] for step in steps], axis=0),
        STEP_SECONDS * np.array(steps, np.float64),
        np.stack([boxes[step][0] for step in steps]),
    )
