"""Logs of Argoverse 2's sensor data set, e.g. ``sensor/val/7fab2350-7eaf-3b7e-a39d-6937a4c1bede``.

Conventions as in av2-api: the car has x forward, y left, z up; ``city_SE3_egovehicle`` is city from car at a time in
nanoseconds; sweeps and boxes are in the car's frame at their own time, sweeps corrected for the car's motion; photos
are rectified already, whatever k1, k2, k3 say of the lens that took them.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Int64
from numpy import ndarray

from instdrive_core.datasets.arrow_tables import read_feather, take_integers, take_numbers, take_texts
from instdrive_core.datasets.clip import Clip, ClipOptions
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
from instdrive_core.datasets.rig_files import FARTHEST, FORWARD_X, build_pose, require_sizes
from instdrive_core.errors import DataError
from instdrive_core.scene.track import Track

CAMERAS = (
    *("ring_front_center", "ring_front_left", "ring_front_right", "ring_side_left", "ring_side_right"),
    *("ring_rear_left", "ring_rear_right"),
)
POSES, BOXES = "city_SE3_egovehicle.feather", "annotations.feather"
TURN, PLACE = ("qw", "qx", "qy", "qz"), ("tx_m", "ty_m", "tz_m")
_HIDDEN: dict[str, int] = {"ring_front_center": 250, "ring_rear_left": 250, "ring_rear_right": 250}
"""Rows at the bottom of the photos that show the car; neurad-studio cuts the same."""
_NEAR = 60_000_000
"""Nanoseconds between a sweep and the photos that belong to its step; sweeps are 100 ms apart, photos 50 ms."""
_REMEDY = "Get the file again"


def holds_argoverse(path: str | Path) -> bool:
    """Whether the folder is one log with poses and sensors."""
    root = Path(path)
    return (root / POSES).is_file() and (root / "sensors").is_dir()


def load_argoverse(path: str | Path, options: ClipOptions) -> Clip:
    """Open a log of Argoverse 2's sensor data set.

    Raises DataError where a file is missing or damaged, OptionError for options that do not fit.
    """
    return build_recorded_clip(read_argoverse(Path(path)), options)


class CarPoses:
    """City from car at any time of a log."""

    def __init__(self, file: Path) -> None:
        """Read them. Raises DataError where the file is damaged."""
        table = read_feather(file, ("timestamp_ns", *TURN, *PLACE))
        numbers, times = take_numbers(file, table, (*TURN, *PLACE)), take_integers(file, table, "timestamp_ns")
        if not len(times):
            raise DataError(file, "holds no pose", _REMEDY)
        order = np.argsort(times, kind="stable")
        poses = np.stack([build_pose(file, row[:4], row[4:], f"row {place}") for place, row in enumerate(numbers)])
        self.file, self.times = file, times[order]
        self._track = Track("car", "", np.ones(3), (self.times - self.times[0]) * 1e-9, poses[order])

    def find(self, time: int) -> Pose:
        """Find the pose at a time in nanoseconds, between neighbours. Raises DataError far outside of the log."""
        if not self.times[0] - _NEAR <= time <= self.times[-1] + _NEAR:
            raise DataError(self.file, f"holds no pose at {time} ns", _REMEDY)
        return self._track.interpolate_pose(float((time - int(self.times[0])) * 1e-9))


def read_argoverse(root: Path) -> Recording:
    """Read poses, lenses and boxes of a log; photos and sweeps when asked for. Raises DataError for damaged files."""
    car = CarPoses(root / POSES)
    listed = {name: _list_by_time(root / "sensors" / "cameras" / name, ".jpg") for name in CAMERAS}
    cameras = {name: files for name, files in listed.items() if files}
    if not cameras:
        raise DataError(root / "sensors", "holds no photo of a ring camera", "Get the log's 'sensors/cameras', too")
    sweeps = _list_by_time(root / "sensors" / "lidar", ".feather")
    moments = _list_steps(sorted(sweeps), sorted(next(iter(cameras.values()))))
    steps = {time: step for step, time in enumerate(moments.tolist())}
    placed = _read_placements(root / "calibration" / "egovehicle_SE3_sensor.feather", tuple(cameras))
    photos = [
        RecordedPhoto(name, step, time * 1e-9, car.find(time) @ placed[name], files[time], open_photo_file(files[time]))
        for name, files in cameras.items()
        for step, time in _match_steps(moments, np.array(sorted(files)))
    ]
    return Recording(
        root=root,
        name=root.resolve().name,
        lenses=_read_lenses(root / "calibration" / "intrinsics.feather", tuple(cameras)),
        step_times={step: time * 1e-9 for time, step in steps.items()},
        photos=tuple(photos),
        sweeps=tuple(
            RecordedSweep(steps[time], time * 1e-9, car.find(time), partial(_load_points, file, time, car.find(time)))
            for time, file in sweeps.items()
        ),
        tracks=_read_tracks(root / BOXES, car) if (root / BOXES).is_file() else (),
        world_from_ego={step: car.find(time) for time, step in steps.items()},
    )


def _list_by_time(folder: Path, ending: str) -> dict[int, Path]:
    files = (file for file in folder.glob(f"*{ending}") if file.stem.isascii() and file.stem.isdecimal())
    return {int(file.stem): file for file in sorted(files) if len(file.stem) <= 18}


def _list_steps(sweeps: list[int], photos: list[int]) -> Int64[ndarray, " t"]:
    """List the times of steps: the sweeps', and of photos that no sweep is near to."""
    known = np.array(sweeps, np.int64)
    alone = [time for time in photos if not len(known) or np.abs(known - time).min() > _NEAR]
    return np.unique(np.r_[known, np.array(alone, np.int64)])


def _match_steps(moments: Int64[ndarray, " t"], photos: Int64[ndarray, " p"]) -> list[tuple[int, int]]:
    """Pairs of a step and the time of the photo nearest to it."""
    nearest = [int(photos[np.argmin(np.abs(photos - time))]) for time in moments]
    return [
        (step, photo)
        for step, (time, photo) in enumerate(zip(moments.tolist(), nearest, strict=True))
        if abs(time - photo) <= _NEAR
    ]


def _read_placements(file: Path, names: tuple[str, ...]) -> dict[str, Pose]:
    """Car from each camera, which has OpenCV axes."""
    table = read_feather(file, ("sensor_name", *TURN, *PLACE))
    sensors, numbers = take_texts(file, table, "sensor_name"), take_numbers(file, table, (*TURN, *PLACE))
    found = {name: build_pose(file, row[:4], row[4:], name) for name, row in zip(sensors, numbers, strict=True)}
    return {name: _require_sensor(file, found, name) for name in names}


def _require_sensor(file: Path, found: dict[str, ndarray], name: str) -> ndarray:
    if name not in found:
        raise DataError(file, f"has no row for the sensor '{name}'", _REMEDY)
    return found[name]


def _read_lenses(file: Path, names: tuple[str, ...]) -> dict[str, Lens]:
    columns = ("fx_px", "fy_px", "cx_px", "cy_px", "width_px", "height_px")
    table = read_feather(file, ("sensor_name", *columns))
    found = dict(zip(take_texts(file, table, "sensor_name"), take_numbers(file, table, columns), strict=True))
    lenses = {}
    for name in names:
        fx, fy, cx, cy, width, height = map(float, _require_sensor(file, found, name))
        camera = build_camera(file, name, (fx, fy, cx, cy), (int(min(width, 1e9)), int(min(height, 1e9))))
        lenses[name] = Lens(camera, hidden=_HIDDEN.get(name, 0) / height if height > 1500 else 0.0)
    return lenses


def _load_points(file: Path, time: int, world_from_car: Pose) -> RecordedPoints:
    table = read_feather(file, ("x", "y", "z", "intensity", "offset_ns"))
    rows = take_numbers(file, table, ("x", "y", "z", "intensity"))
    wrong = np.flatnonzero(~(np.abs(rows[:, :3]) < FARTHEST).all(axis=1))
    if len(wrong):
        raise DataError(file, f"row {wrong[0]} lies at {rows[wrong[0], :3].tolist()}", _REMEDY)
    points = rows[:, :3] @ world_from_car[:3, :3].T + world_from_car[:3, 3]
    times = (time + take_integers(file, table, "offset_ns")) * 1e-9
    intensity = np.clip(rows[:, 3] / 255, 0, 1).astype(np.float32)
    return RecordedPoints(points, intensity, np.zeros(len(points), np.uint8), times)


def _read_tracks(file: Path, car: CarPoses) -> tuple[Track, ...]:
    sizes = ("width_m", "length_m", "height_m")
    table = read_feather(file, ("timestamp_ns", "track_uuid", "category", *sizes, *TURN, *PLACE))
    times, numbers = take_integers(file, table, "timestamp_ns"), take_numbers(file, table, (*sizes, *TURN, *PLACE))
    known, labels = take_texts(file, table, "track_uuid"), take_texts(file, table, "category")
    moments = {time: car.find(time) for time in np.unique(times).tolist()}
    rows_of: dict[str, dict[int, int]] = {}
    for row, (name, time) in enumerate(zip(known, times.tolist(), strict=True)):
        require_sizes(file, numbers[row, :3], f"row {row}")
        rows_of.setdefault(name, {})[time] = row
    tracks = []
    for name, rows in rows_of.items():
        ordered = sorted(rows)
        boxes = [build_pose(file, numbers[rows[t], 3:7], numbers[rows[t], 7:], f"row {rows[t]}") for t in ordered]
        poses = np.stack([moments[t] @ box @ FORWARD_X for t, box in zip(ordered, boxes, strict=True)])
        dimensions = np.median(numbers[[rows[t] for t in ordered], :3], axis=0)
        tracks.append(Track(name, labels[rows[ordered[0]]], dimensions, np.array(ordered) * 1e-9, poses))
    return tuple(tracks)
