"""Raw drives of KITTI, synchronised and rectified: ``2011_09_26/2011_09_26_drive_0001_sync``.

Conventions as in the devkit's ``dataformat.txt``: the IMU and the LiDAR have x forward, y left, z up; the GPS is
projected by Mercator, the first latitude's cosine being its scale; all rectified cameras share camera 0's axes.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np

from instdrive_core.datasets.clip import Clip, ClipOptions
from instdrive_core.datasets.kitti.numbers import (
    pose_from_oxts,
    read_named_numbers,
    read_times,
    require_matrix,
    require_rotation,
)
from instdrive_core.datasets.kitti.rig import COLOR_CAMERAS, KittiRig, list_counted_files, list_photos, list_sweeps
from instdrive_core.datasets.kitti.tracklets import read_tracklets
from instdrive_core.datasets.recorded_clips import build_recorded_clip
from instdrive_core.datasets.recording import Pose, Recording
from instdrive_core.datasets.rig_files import invert_pose, parse_numbers, require_pose
from instdrive_core.errors import DataError
from instdrive_core.files.text_file import read_text

_GREY_CAMERAS = ("image_00", "image_01")
CALIBRATIONS = ("calib_cam_to_cam.txt", "calib_velo_to_cam.txt", "calib_imu_to_velo.txt")


def holds_kitti_raw(path: str | Path) -> bool:
    """Whether the folder is one drive with photos and poses of the GPS."""
    root = Path(path)
    return (root / "oxts" / "data").is_dir() and any((root / name / "data").is_dir() for name in _all_cameras())


def load_kitti_raw(path: str | Path, options: ClipOptions) -> Clip:
    """Open a raw drive of KITTI.

    Raises DataError where a file is missing or damaged, OptionError for options that do not fit.
    """
    return build_recorded_clip(read_kitti_raw(Path(path)), options)


def read_kitti_raw(root: Path) -> Recording:
    """Read poses, lenses and boxes of a drive; photos and sweeps when asked for."""
    cameras = {name: list_counted_files(root / name / "data", ".png") for name in _all_cameras()}
    names = [name for name in COLOR_CAMERAS if cameras[name]] or [name for name in _GREY_CAMERAS if cameras[name]]
    if not names:
        raise DataError(root, "holds no photo such as image_02/data/0000000000.png", "Get the drive's photos")
    rig = _read_rig(root, names)
    poses = _read_poses(root)
    times = _read_times(root, poses)
    chosen = {name: cameras[name] for name in names}
    unposed = sum(step not in poses for files in chosen.values() for step in files)
    sweeps = list_sweeps(
        list_counted_files(root / "velodyne_points" / "data", ".bin"), poses, rig.imu_from_velodyne, times
    )
    labels = root / "tracklet_labels.xml"
    frames = {step: pose @ rig.imu_from_velodyne for step, pose in poses.items()}
    return Recording(
        root=root,
        name=root.resolve().name,
        lenses={name: rig.build_lens(name, next(iter(chosen[name].values()))) for name in names},
        step_times=times,
        photos=list_photos(rig, chosen, poses, times),
        sweeps=sweeps,
        tracks=read_tracklets(labels, frames, times) if labels.is_file() else (),
        world_from_ego=poses,
        notes=(f"{unposed} photos without a pose are left out",) if unposed else (),
    )


def _all_cameras() -> tuple[str, ...]:
    return (*COLOR_CAMERAS, *_GREY_CAMERAS)


def _read_rig(root: Path, names: list[str]) -> KittiRig:
    """The calibration of the day, which lies beside its drives."""
    folder = root.resolve().parent
    between, velodyne, imu = (folder / name for name in CALIBRATIONS)
    found = read_named_numbers(between)
    projections = {name: require_matrix(between, found, (f"P_rect_{name[-2:]}",), (3, 4)) for name in names}
    rectified = require_rotation(between, found, ("R_rect_00",)) @ _read_rigid(velodyne)
    return KittiRig(between, invert_pose(_read_rigid(imu)), rectified, projections)


def _read_rigid(file: Path) -> Pose:
    found = read_named_numbers(file)
    turn, place = require_matrix(file, found, ("R",), (3, 3)), require_matrix(file, found, ("T",), (3, 1))
    return require_pose(file, np.hstack([turn, place]), "R, T")


def _read_poses(root: Path) -> dict[int, Pose]:
    poses: dict[int, Pose] = {}
    scale = None
    for step, file in list_counted_files(root / "oxts" / "data", ".txt").items():
        values = parse_numbers(file, read_text(file).split(), "the line")
        if scale is None:
            scale = float(np.cos(np.radians(values[0]))) if len(values) else 1.0
        poses[step] = pose_from_oxts(file, values, scale)
    if not poses:
        raise DataError(root / "oxts" / "data", "holds no pose such as 0000000000.txt", "Get the drive's 'oxts', too")
    return poses


def _read_times(root: Path, poses: dict[int, Pose]) -> dict[int, float]:
    file = root / "oxts" / "timestamps.txt"
    times = read_times(file)
    if max(poses) >= len(times) or any(later <= earlier for earlier, later in pairwise(times)):
        problem = f"holds {len(times)} times for the steps up to {max(poses)}, or they do not rise"
        raise DataError(file, problem, "Get the file again")
    return {step: times[step] for step in poses}
