"""Writes the first camera of a recording as KITTI stores its left colour camera, with LiDAR and boxes.

KITTI has one rig with rectified cameras in a row, so the other cameras of a ring have no place in it. The car's frame
becomes the IMU, at a place in Karlsruhe; the LiDAR and camera 0 sit beside it about as they do on KITTI's car.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.datasets.kitti.numbers import format_time, oxts_from_pose, pose_from_oxts
from instdrive_core.datasets.kitti.raw import CALIBRATIONS
from instdrive_core.datasets.layout_files import (
    encode_png,
    find_level_heading,
    list_boxes,
    number_steps,
    place_cameras,
    require_new_folder,
    write_layout_file,
)
from instdrive_core.datasets.recording import Lens, Pose, RecordedPhoto, RecordedSweep, Recording
from instdrive_core.datasets.rig_files import invert_pose
from instdrive_core.errors import DataError
from instdrive_core.scene.track import Track

DAY, DRIVE = "2011_09_26", "2011_09_26_drive_0001_sync"
SEQUENCE = "0000"
_PLACE = np.array([49.01, 8.43, 0.0, 0, 0, 0])
"""Latitude and longitude of the first pose."""
_BASELINE = 0.06
"""Metres from camera 2 to camera 0, which is to its right."""
_VELODYNE_FROM_IMU = np.array([[1.0, 0, 0, -0.81], [0, 1, 0, 0.32], [0, 0, 1, -0.8], [0, 0, 0, 1]])


@dataclass(frozen=True)
class _Plan:
    """The recording as KITTI's rig would have recorded it."""

    numbers: dict[int, int]
    lens: Lens
    photos: dict[int, RecordedPhoto]
    """The first camera's by step."""
    world_from_imu: dict[int, Pose]
    """In the recording's world."""
    shift: Float64[ndarray, "3"]
    """Metres from the recording's world to KITTI's."""
    scale: float
    rectified_from_velodyne: Pose

    def describe_pose(self, step: int) -> list[float]:
        """The oxts line of a step."""
        pose = self.world_from_imu[step].copy()
        pose[:3, 3] += self.shift
        return oxts_from_pose(pose, self.scale)

    def place_velodyne(self, step: int) -> Pose:
        """World from LiDAR."""
        return self.world_from_imu[step] @ invert_pose(_VELODYNE_FROM_IMU)

    def place_camera_0(self, step: int) -> Pose:
        """World from the rectified axes of camera 0."""
        return self.place_velodyne(step) @ invert_pose(self.rectified_from_velodyne)

    def build_projection(self) -> Float64[ndarray, "3 4"]:
        """Pixels of camera 2 from the rectified axes of camera 0."""
        camera = self.lens.camera
        inner = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
        return inner @ np.array([[1.0, 0, 0, _BASELINE], [0, 1, 0, 0], [0, 0, 1, 0]])


def _make_plan(recording: Recording) -> _Plan:
    name = next(iter(recording.lenses))
    imu_from_camera = place_cameras(recording)[name]
    photos = {photo.step: photo for photo in recording.photos if photo.camera == name}
    if not photos:
        raise DataError(
            recording.root, f"{name} has no photo, and KITTI's layout holds only that camera", "Choose others"
        )
    poses = {step: photo.world_from_camera @ invert_pose(imu_from_camera) for step, photo in photos.items()}
    scale = float(np.cos(np.radians(_PLACE[0])))
    shift = pose_from_oxts(recording.root, _PLACE, scale)[:3, 3] - poses[min(poses)][:3, 3]
    offset = np.eye(4)
    offset[0, 3] = _BASELINE
    rectified = invert_pose(offset) @ invert_pose(imu_from_camera) @ invert_pose(_VELODYNE_FROM_IMU)
    numbers = {step: number for step, number in number_steps(recording).items() if step in poses}
    return _Plan(numbers, recording.lenses[name], photos, poses, shift, scale, rectified)


def write_kitti_raw(recording: Recording, folder: Path) -> Path:
    """Write the first camera, the LiDAR and the boxes of a recording as a raw drive of KITTI.

    Lens distortion is not written. Returns the folder to open. Raises DataError where the folder is not empty.
    """
    require_new_folder(folder)
    plan, drive = _make_plan(recording), folder / DAY / DRIVE
    between, velodyne, imu = (folder / DAY / name for name in CALIBRATIONS)
    _write_lines(between, {"R_rect_00": np.eye(3), "P_rect_02": plan.build_projection()})
    for file, pose in ((velodyne, plan.rectified_from_velodyne), (imu, _VELODYNE_FROM_IMU)):
        _write_lines(file, {"R": pose[:3, :3], "T": pose[:3, 3]})
    times = []
    for step, number in plan.numbers.items():
        write_layout_file(drive / "image_02" / "data" / f"{number:010d}.png", encode_png(plan.photos[step]))
        write_layout_file(drive / "oxts" / "data" / f"{number:010d}.txt", _join(plan.describe_pose(step)).encode())
        times.append(format_time(recording.step_times[step]))
    write_layout_file(drive / "oxts" / "timestamps.txt", ("\n".join(times) + "\n").encode())
    for sweep in recording.sweeps:
        if sweep.step in plan.numbers:
            file = drive / "velodyne_points" / "data" / f"{plan.numbers[sweep.step]:010d}.bin"
            write_layout_file(file, _pack_points(sweep, plan.place_velodyne(sweep.step)))
    write_layout_file(drive / "tracklet_labels.xml", _describe_tracklets(recording, plan).encode())
    return drive


def write_kitti_tracking(recording: Recording, folder: Path) -> Path:
    """Write the first camera, the LiDAR and the boxes of a recording as a sequence of KITTI's tracking benchmark.

    Lens distortion and times are not written. Returns the folder to open. Raises DataError where the folder is not
    empty.
    """
    require_new_folder(folder)
    plan, root = _make_plan(recording), folder / "training"
    calibration = {
        "P2": plan.build_projection(),
        "R_rect": np.eye(3),
        "Tr_velo_cam": plan.rectified_from_velodyne[:3],
        "Tr_imu_velo": _VELODYNE_FROM_IMU[:3],
    }
    _write_lines(root / "calib" / f"{SEQUENCE}.txt", calibration)
    steps = list(plan.numbers)
    for step in steps:
        file = root / "image_02" / SEQUENCE / f"{plan.numbers[step]:06d}.png"
        write_layout_file(file, encode_png(plan.photos[step]))
    lines = [_join(plan.describe_pose(step)) for step in steps]
    write_layout_file(root / "oxts" / f"{SEQUENCE}.txt", ("\n".join(lines) + "\n").encode())
    for sweep in recording.sweeps:
        if sweep.step in plan.numbers:
            file = root / "velodyne" / SEQUENCE / f"{plan.numbers[sweep.step]:06d}.bin"
            write_layout_file(file, _pack_points(sweep, plan.place_velodyne(sweep.step)))
    write_layout_file(root / "label_02" / f"{SEQUENCE}.txt", _describe_labels(recording, plan).encode())
    return root / "image_02" / SEQUENCE


def _join(values: list[float]) -> str:
    return " ".join(map(repr, values))


def _write_lines(file: Path, matrices: dict[str, Float64[ndarray, "..."]]) -> None:
    lines = [f"{name}: {_join(matrix.ravel().tolist())}" for name, matrix in matrices.items()]
    write_layout_file(file, ("\n".join(lines) + "\n").encode())


def _pack_points(sweep: RecordedSweep, world_from_velodyne: Pose) -> bytes:
    loaded, inverse = sweep.load(), invert_pose(world_from_velodyne)
    points = loaded.points @ inverse[:3, :3].T + inverse[:3, 3]
    return np.column_stack([points, loaded.intensity]).astype("<f4").tobytes()


def _describe_tracklets(recording: Recording, plan: _Plan) -> str:
    """The XML of all boxes; a track with a gap becomes two tracklets, which have no gaps."""
    runs: list[tuple[Track, list[tuple[int, Pose]]]] = []
    open_runs: dict[int, tuple[int, list[tuple[int, Pose]]]] = {}
    for step, boxes in sorted(list_boxes(recording).items()):
        if step not in plan.numbers:
            continue
        number = plan.numbers[step]
        local = invert_pose(plan.place_velodyne(step))
        for place, track, pose in boxes:
            last, run = open_runs.get(place, (-2, []))
            if last != number - 1:
                run = []
                runs.append((track, run))
            run.append((number, local @ pose))
            open_runs[place] = (number, run)
    items = "".join(
        _describe_run(track, run, lambda number: plan.place_velodyne(_step_of(plan, number))) for track, run in runs
    )
    return (
        '<?xml version="1.0" encoding="UTF-8" standalone="yes" ?>\n<!DOCTYPE boost_serialization>\n'
        '<boost_serialization signature="serialization::archive" version="9">\n<tracklets>\n'
        f"<count>{len(runs)}</count>\n<item_version>1</item_version>\n{items}</tracklets>\n</boost_serialization>\n"
    )


def _step_of(plan: _Plan, number: int) -> int:
    return next(step for step, known in plan.numbers.items() if known == number)


def _describe_run(track: Track, run: list[tuple[int, Pose]], place: Callable[[int], Pose]) -> str:
    width, length, height = track.dimensions.tolist()
    poses = "".join(_describe_tracklet_pose(local, height, place(number)) for number, local in run)
    label = "".join(sign if sign.isalnum() or sign in " -_." else "_" for sign in track.label)
    return (
        f"<item>\n<objectType>{label}</objectType>\n<h>{height!r}</h>\n<w>{width!r}</w>\n<l>{length!r}</l>\n"
        f"<first_frame>{run[0][0]}</first_frame>\n<poses>\n<count>{len(run)}</count>\n<item_version>2</item_version>\n"
        f"{poses}</poses>\n<finished>1</finished>\n</item>\n"
    )


def _describe_tracklet_pose(local: Pose, height: float, world_from_velodyne: Pose) -> str:
    forward = world_from_velodyne[:3, :3] @ local[:3, 1]
    heading = find_level_heading(world_from_velodyne[:3, :3], forward, (0, 1))
    x, y, z = (local[:3, 3] - (0, 0, height / 2)).tolist()
    yaw = float(np.arctan2(heading[1], heading[0]))
    return (
        f"<item><tx>{x!r}</tx><ty>{y!r}</ty><tz>{z!r}</tz><rx>0</rx><ry>0</ry><rz>{yaw!r}</rz><state>2</state>"
        "<occlusion>0</occlusion><occlusion_kf>0</occlusion_kf><truncation>0</truncation></item>\n"
    )


def _describe_labels(recording: Recording, plan: _Plan) -> str:
    lines = []
    for step, boxes in sorted(list_boxes(recording).items()):
        if step not in plan.numbers:
            continue
        frame = plan.place_camera_0(step)
        for place, track, pose in boxes:
            width, length, height = track.dimensions.tolist()
            local = invert_pose(frame) @ pose
            heading = find_level_heading(frame[:3, :3], pose[:3, 1], (0, 2))
            x, y, z = (local[:3, 3] + (0, height / 2, 0)).tolist()
            turn = float(np.arctan2(-heading[1], heading[0]))
            label = "".join(sign if sign.isalnum() else "_" for sign in track.label)
            numbers = [height, width, length, x, y, z, turn]
            lines.append(f"{plan.numbers[step]} {place} {label} 0 0 -10 -1 -1 -1 -1 {_join(numbers)}")
    return "\n".join(lines) + "\n"
