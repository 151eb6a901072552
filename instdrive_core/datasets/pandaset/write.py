"""Writes a recording as a sequence of PandaSet, its files as the originals have them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from instdrive_core.datasets.layout_files import (
    encode_jpeg,
    list_boxes,
    number_steps,
    require_new_folder,
    write_json_file,
    write_layout_file,
)
from instdrive_core.datasets.pandaset.clips import CAMERAS
from instdrive_core.datasets.pickled_tables import build_object_column, describe_pose, write_table
from instdrive_core.datasets.recording import Pose, RecordedSweep, Recording
from instdrive_core.scene.track import Track


def write_pandaset(recording: Recording, folder: Path) -> Path:
    """Write a recording as a sequence of PandaSet.

    Cameras with other names take PandaSet's in their order, as far as these go; photos are JPEGs, boxes stand upright,
    steps count from 0, and lens distortion is not written. Returns the folder to open. Raises DataError where the
    folder is not empty, MissingExtraError without pandas.
    """
    require_new_folder(folder)
    numbers = number_steps(recording)
    stamps = [recording.step_times[step] for step in numbers]
    for name, listed in name_pandaset_cameras(tuple(recording.lenses)).items():
        place = folder / "camera" / listed
        camera = recording.lenses[name].camera
        photos = {photo.step: photo for photo in recording.photos if photo.camera == name}
        for step, photo in photos.items():
            write_layout_file(place / f"{numbers[step]:02d}.jpg", encode_jpeg(photo))
        # Every step has a pose, also one without a photo.
        near = [photos[min(photos, key=lambda known, step=step: abs(known - step))] for step in numbers]
        write_json_file(place / "poses.json", [describe_pose(photo.world_from_camera) for photo in near])
        write_json_file(place / "intrinsics.json", {key: getattr(camera, key) for key in ("fx", "fy", "cx", "cy")})
        taken = {step: photo.time for step, photo in photos.items()}
        write_json_file(place / "timestamps.json", [taken.get(step, recording.step_times[step]) for step in numbers])
    write_json_file(folder / "meta" / "timestamps.json", stamps)
    if recording.sweeps:
        _write_sweeps(recording, folder / "lidar", numbers, stamps)
    for step, boxes in list_boxes(recording).items():
        if boxes:
            write_table(folder / "annotations" / "cuboids" / f"{numbers[step]:02d}.pkl.gz", _list_cuboids(boxes))
    return folder


def name_pandaset_cameras(names: tuple[str, ...]) -> dict[str, str]:
    """Choose the name that each camera has in PandaSet's layout: its own where all are PandaSet's."""
    if set(names) <= set(CAMERAS):
        return {name: name for name in names}
    return {name: CAMERAS[rank] if rank < len(CAMERAS) else f"camera_{rank}" for rank, name in enumerate(names)}


def _write_sweeps(recording: Recording, folder: Path, numbers: dict[int, int], stamps: list[float]) -> None:
    poses = {sweep.step: sweep.world_from_lidar for sweep in recording.sweeps}
    for sweep in recording.sweeps:
        write_table(folder / f"{numbers[sweep.step]:02d}.pkl.gz", _list_points(sweep), "index")
    near = [poses[min(poses, key=lambda known, step=step: abs(known - step))] for step in numbers]
    write_json_file(folder / "poses.json", [describe_pose(pose) for pose in near])
    write_json_file(folder / "timestamps.json", stamps)


def _list_points(sweep: RecordedSweep) -> dict[str, np.ndarray]:
    loaded = sweep.load()
    times = np.full(len(loaded.points), sweep.time) if loaded.times is None else loaded.times
    columns = {name: loaded.points[:, axis].copy() for axis, name in enumerate("xyz")}
    intensity = loaded.intensity.astype(np.float64) * 255
    return columns | {"i": intensity, "t": times, "d": loaded.sensor.astype(np.int64)}


def _list_cuboids(boxes: list[tuple[int, Track, Pose]]) -> dict[str, np.ndarray]:
    tracks, poses = [track for _, track, _ in boxes], np.stack([pose for _, _, pose in boxes])
    sizes = np.stack([track.dimensions for track in tracks])
    columns: dict[str, np.ndarray] = {
        "uuid": build_object_column([track.id for track in tracks]),
        "label": build_object_column([track.label for track in tracks]),
        "yaw": np.arctan2(-poses[:, 0, 1], poses[:, 1, 1]),
        "stationary": np.array([not track.moving for track in tracks]),
        "camera_used": np.full(len(tracks), -1, np.int64),
    }
    columns |= {f"position.{axis}": poses[:, place, 3].copy() for place, axis in enumerate("xyz")}
    columns |= {f"dimensions.{axis}": sizes[:, place].copy() for place, axis in enumerate("xyz")}
    unsaid = {"attributes.object_motion": np.nan, "cuboids.sibling_id": "-"}
    columns |= {name: build_object_column([value] * len(tracks)) for name, value in unsaid.items()}
    return columns | {"cuboids.sensor_id": np.full(len(tracks), -1, np.int64)}
