"""Writes a recording as a scene of nuScenes or as a T4 data set, each step a key frame."""

from __future__ import annotations

import hashlib
import io
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from instdrive_core.datasets.layout_files import (
    encode_jpeg,
    list_boxes,
    place_cameras,
    require_new_folder,
    write_json_file,
    write_layout_file,
)
from instdrive_core.datasets.nuscenes.clips import CAMERAS, T4_TABLES
from instdrive_core.datasets.recording import Lens, Pose, RecordedSweep, Recording
from instdrive_core.datasets.rig_files import FORWARD_X, invert_pose
from instdrive_core.maths.rotations import quaternion_from_matrix

VERSION = "v1.0-mini"
_LIDAR = "LIDAR_TOP"
_MAP = "maps/blank.png"
Rows = list[dict[str, Any]]


def write_nuscenes(recording: Recording, folder: Path) -> Path:
    """Write a recording as the only scene of nuScenes' tables.

    Cameras take nuScenes' names in their order; photos are JPEGs; times are rounded to microseconds, lens distortion
    and the points' times are not written. Returns the folder to open. Raises DataError where the folder is not empty.
    """
    return _write_tables(recording, folder, VERSION, "samples")


def write_t4(recording: Recording, folder: Path) -> Path:
    """Write a recording as a T4 data set: nuScenes' tables with lens distortion, its files below ``data``.

    Returns the folder to open. Raises DataError where the folder is not empty.
    """
    return _write_tables(recording, folder, T4_TABLES, "data")


def _write_tables(recording: Recording, folder: Path, tables: str, files: str) -> Path:
    require_new_folder(folder)
    names = {
        name: CAMERAS[rank] if rank < len(CAMERAS) else f"CAM_{rank}" for rank, name in enumerate(recording.lenses)
    }
    steps = sorted(recording.step_times)
    times = {step: round(recording.step_times[step] * 1e6) for step in steps}
    placed = place_cameras(recording)
    ego: Rows = []
    data: Rows = []

    def add(channel: str, step: int, world_from_car: Pose, ending: str, size: tuple[int, int], content: bytes) -> None:
        file = f"{files}/{channel}/{steps.index(step):05d}.{ending}"
        write_layout_file(folder / file, content)
        token = _token("sample_data", channel, step)
        ego.append({"token": token, "timestamp": times[step]} | _describe_pose(world_from_car))
        data.append(
            {
                "token": token,
                "sample_token": _token("sample", step),
                "ego_pose_token": token,
                "calibrated_sensor_token": _token("calibrated_sensor", channel),
                "timestamp": times[step],
                "fileformat": ending.split(".")[0],
                "is_key_frame": True,
                "width": size[0],
                "height": size[1],
                "filename": file,
                "prev": "",
                "next": "",
            }
        )

    for photo in recording.photos:
        camera = recording.lenses[photo.camera].camera
        car = photo.world_from_camera @ invert_pose(placed[photo.camera])
        add(names[photo.camera], photo.step, car, "jpg", (camera.width, camera.height), encode_jpeg(photo))
    for sweep in recording.sweeps:
        car = recording.world_from_ego[sweep.step]
        add(_LIDAR, sweep.step, car, "pcd.bin", (0, 0), _pack_points(sweep, car))
    _link(data, "calibrated_sensor_token")
    scene = {"token": _token("scene"), "log_token": _token("log"), "nbr_samples": len(steps), "name": recording.name}
    scene |= {"first_sample_token": _token("sample", steps[0]), "last_sample_token": _token("sample", steps[-1])}
    samples: Rows = [
        {"token": _token("sample", step), "timestamp": times[step], "scene_token": _token("scene")} for step in steps
    ]
    _link(samples, "scene_token")
    log = {"token": _token("log"), "logfile": "", "vehicle": "", "date_captured": "", "location": ""}
    written = {"scene": [scene | {"description": ""}], "sample": samples, "sample_data": data, "ego_pose": ego}
    written |= {"log": [log], "attribute": [], "visibility": [], "map": [_write_blank_map(folder)]}
    written |= _describe_rig(recording, names, placed) | _describe_boxes(recording)
    for name, rows in written.items():
        write_json_file(folder / tables / f"{name}.json", rows)
    return folder


def _write_blank_map(folder: Path) -> dict[str, Any]:
    """Write a map on which nothing is drivable, and describe it: nuscenes-devkit opens no data set without one."""
    packed = io.BytesIO()
    Image.new("L", (1, 1)).save(packed, "PNG")
    write_layout_file(folder / _MAP, packed.getvalue())
    return {"token": _token("map"), "log_tokens": [_token("log")], "category": "semantic_prior", "filename": _MAP}


def _token(*parts: object) -> str:
    return hashlib.md5("/".join(map(str, parts)).encode(), usedforsecurity=False).hexdigest()


def _link(rows: Rows, key: str) -> None:
    """Let each row name the ones before and after it among those with the same `key`."""
    last: dict[str, dict[str, Any]] = {}
    for row in rows:
        before = last.get(row[key])
        row["prev"], row["next"] = "" if before is None else before["token"], ""
        if before is not None:
            before["next"] = row["token"]
        last[row[key]] = row


def _describe_pose(pose: Pose) -> dict[str, list[float]]:
    return {"rotation": quaternion_from_matrix(pose[:3, :3]).tolist(), "translation": pose[:3, 3].tolist()}


def _describe_rig(recording: Recording, names: dict[str, str], placed: dict[str, Pose]) -> dict[str, Rows]:
    mounts: Rows = [_describe_mount(names[name], placed[name], recording.lenses[name]) for name in placed]
    sensors: Rows = [
        {"token": _token("sensor", names[name]), "channel": names[name], "modality": "camera"} for name in placed
    ]
    mounts.append(_describe_mount(_LIDAR, np.eye(4), None))
    sensors.append({"token": _token("sensor", _LIDAR), "channel": _LIDAR, "modality": "lidar"})
    return {"calibrated_sensor": mounts, "sensor": sensors}


def _describe_mount(channel: str, car_from_sensor: Pose, lens: Lens | None) -> dict[str, Any]:
    row: dict[str, Any] = {"token": _token("calibrated_sensor", channel), "sensor_token": _token("sensor", channel)}
    row |= _describe_pose(car_from_sensor) | {"camera_intrinsic": [], "camera_distortion": []}
    if lens is not None:
        camera, k = lens.camera, (*lens.distortion.radial, 0.0, 0.0, 0.0)
        row["camera_intrinsic"] = [[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]]
        row["camera_distortion"] = [k[0], k[1], *lens.distortion.tangential, k[2]]
    return row


def _pack_points(sweep: RecordedSweep, world_from_car: Pose) -> bytes:
    loaded, inverse = sweep.load(), invert_pose(world_from_car)
    points = loaded.points @ inverse[:3, :3].T + inverse[:3, 3]
    return np.column_stack([points, loaded.intensity * 255, np.full(len(points), -1.0)]).astype("<f4").tobytes()


def _describe_boxes(recording: Recording) -> dict[str, Rows]:
    annotations: Rows = []
    sweeps = {sweep.step: sweep for sweep in recording.sweeps}
    for step, boxes in sorted(list_boxes(recording).items()):
        points = sweeps[step].load().points if step in sweeps else np.zeros((0, 3), np.float32)
        for place, track, pose in boxes:
            row = {"token": _token("annotation", place, step), "sample_token": _token("sample", step)}
            row |= {"instance_token": _token("instance", place), "visibility_token": "", "attribute_tokens": []}
            local = (points - pose[:3, 3]) @ pose[:3, :3]
            inside = int((np.abs(local) <= track.dimensions / 2).all(axis=1).sum())
            annotations.append(
                row
                | _describe_pose(pose @ FORWARD_X.T)
                | {"size": track.dimensions.tolist(), "num_lidar_pts": inside, "num_radar_pts": 0}
            )
    _link(annotations, "instance_token")
    counts: dict[str, list[str]] = {}
    for row in annotations:
        counts.setdefault(row["instance_token"], []).append(row["token"])
    instances: Rows = [
        {
            "token": _token("instance", place),
            "instance_name": track.id,
            "category_token": _token("category", track.label),
            "nbr_annotations": len(counts[_token("instance", place)]),
            "first_annotation_token": counts[_token("instance", place)][0],
            "last_annotation_token": counts[_token("instance", place)][-1],
        }
        for place, track in enumerate(recording.tracks)
        if _token("instance", place) in counts
    ]
    labels = sorted({track.label for track in recording.tracks})
    categories: Rows = [{"token": _token("category", name), "name": name, "description": ""} for name in labels]
    return {"sample_annotation": annotations, "instance": instances, "category": categories}
