"""Writes a recording as a log of Argoverse 2's sensor data set."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.datasets.argoverse.clips import BOXES, CAMERAS, PLACE, POSES, TURN
from instdrive_core.datasets.layout_files import (
    encode_jpeg,
    list_boxes,
    place_cameras,
    require_new_folder,
    write_layout_file,
)
from instdrive_core.datasets.recording import Pose, Recording
from instdrive_core.datasets.rig_files import FORWARD_X, invert_pose
from instdrive_core.errors import OptionError
from instdrive_core.maths.rotations import quaternion_from_matrix

_GAP = 1000
"""Nanoseconds between the photos of a step, so that each has a pose of the car of its own."""


def write_argoverse(recording: Recording, folder: Path) -> Path:
    """Write a recording as a log: cameras take the names of the ring's in their order, sweeps are in the car's frame.

    Points are 32-bit floats, where Argoverse rounds to 16 bits. Returns the folder to open. Raises DataError where the
    folder is not empty, OptionError for more cameras than the ring has.
    """
    if len(recording.lenses) > len(CAMERAS):
        raise OptionError(f"{len(recording.lenses)} cameras do not fit into Argoverse's ring of {len(CAMERAS)}")
    require_new_folder(folder)
    names = dict(zip(recording.lenses, CAMERAS, strict=False))
    placed = place_cameras(recording)
    moments = {step: round(time * 1e9) for step, time in recording.step_times.items()}
    poses = {moments[step]: pose for step, pose in recording.world_from_ego.items() if step in moments}
    for photo in recording.photos:
        time = moments[photo.step] + _GAP * (1 + list(names).index(photo.camera))
        poses[time] = photo.world_from_camera @ invert_pose(placed[photo.camera])
        file = folder / "sensors" / "cameras" / names[photo.camera] / f"{time}.jpg"
        write_layout_file(file, encode_jpeg(photo))
    rows = {"timestamp_ns": np.array(sorted(poses))} | _list_poses([poses[time] for time in sorted(poses)])
    _write_feather(folder / POSES, rows)
    used = [name for name in names if name in placed]
    sensors = {"sensor_name": [names[name] for name in used]} | _list_poses([placed[name] for name in used])
    _write_feather(folder / "calibration" / "egovehicle_SE3_sensor.feather", sensors)
    _write_lenses(recording, names, folder / "calibration" / "intrinsics.feather")
    for sweep in recording.sweeps:
        loaded, time = sweep.load(), moments[sweep.step]
        inverse = invert_pose(recording.world_from_ego[sweep.step])
        points = (loaded.points @ inverse[:3, :3].T + inverse[:3, 3]).astype(np.float32)
        offsets = np.zeros(len(points)) if loaded.times is None else loaded.times * 1e9 - time
        columns = dict(zip("xyz", points.T, strict=True))
        columns |= {
            "intensity": np.round(loaded.intensity * 255).astype(np.uint8),
            "laser_number": loaded.sensor,
            "offset_ns": np.clip(np.round(offsets), -(2**31), 2**31 - 1).astype(np.int32),
        }
        _write_feather(folder / "sensors" / "lidar" / f"{time}.feather", columns)
    _write_boxes(recording, moments, folder / BOXES)
    return folder


def _list_poses(poses: list[Pose]) -> dict[str, Float64[ndarray, " n"]]:
    stacked = np.array(poses).reshape(-1, 4, 4)
    columns = zip(TURN, quaternion_from_matrix(stacked[:, :3, :3]).T, strict=True)
    return dict(columns) | dict(zip(PLACE, stacked[:, :3, 3].T, strict=True))


def _write_lenses(recording: Recording, names: dict[str, str], file: Path) -> None:
    cameras = [lens.camera for lens in recording.lenses.values()]
    columns: dict[str, Any] = {"sensor_name": list(names.values())}
    for column, field in (("fx_px", "fx"), ("fy_px", "fy"), ("cx_px", "cx"), ("cy_px", "cy")):
        columns[column] = np.array([getattr(camera, field) for camera in cameras], np.float64)
    columns |= {name: np.zeros(len(cameras)) for name in ("k1", "k2", "k3")}
    columns["height_px"] = np.array([camera.height for camera in cameras], np.uint16)
    columns["width_px"] = np.array([camera.width for camera in cameras], np.uint16)
    _write_feather(file, columns)


def _write_boxes(recording: Recording, moments: dict[int, int], file: Path) -> None:
    found = [(step, track, pose) for step, boxes in sorted(list_boxes(recording).items()) for _, track, pose in boxes]
    local = [invert_pose(recording.world_from_ego[step]) @ pose @ FORWARD_X.T for step, _, pose in found]
    sizes = np.array([track.dimensions for _, track, _ in found]).reshape(-1, 3)
    columns: dict[str, Any] = {
        "timestamp_ns": np.array([moments[step] for step, _, _ in found], np.int64),
        "track_uuid": [track.id for _, track, _ in found],
        "category": [track.label for _, track, _ in found],
        "length_m": sizes[:, 1],
        "width_m": sizes[:, 0],
        "height_m": sizes[:, 2],
    }
    columns |= _list_poses(local) | {"num_interior_pts": np.zeros(len(found), np.int64)}
    _write_feather(file, columns)


def _write_feather(file: Path, columns: dict[str, Any]) -> None:
    import pyarrow as pa
    from pyarrow import feather

    texts = {name: pa.array(values, pa.string()) for name, values in columns.items() if isinstance(values, list)}
    table = pa.table({name: texts.get(name, values) for name, values in columns.items()})
    file.parent.mkdir(parents=True, exist_ok=True)
    feather.write_feather(table, str(file), compression="uncompressed")
