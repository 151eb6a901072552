"""Writes a recording as drivestudio's preprocessing writes PandaSet: a pose for each photo holds for any rig."""

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
    write_matrix,
)
from instdrive_core.datasets.recording import Lens, RecordedSweep, Recording
from instdrive_core.datasets.rig_files import invert_pose


def write_drivestudio(recording: Recording, folder: Path) -> Path:
    """Write a recording in drivestudio's layout. Cameras become numbers, photos JPEGs; times are lost but for their
    order. Returns the folder to open. Raises DataError where the folder is not empty.
    """
    require_new_folder(folder)
    numbers = number_steps(recording)
    cameras = {name: rank for rank, name in enumerate(recording.lenses)}
    for name, lens in recording.lenses.items():
        write_matrix(folder / "intrinsics" / f"{cameras[name]}.txt", _list_intrinsics(lens)[:, None])
    for photo in recording.photos:
        stem = f"{numbers[photo.step]:03d}_{cameras[photo.camera]}"
        write_layout_file(folder / "images" / f"{stem}.jpg", encode_jpeg(photo))
        write_matrix(folder / "extrinsics" / f"{stem}.txt", photo.world_from_camera)
    for step, number in numbers.items():
        write_matrix(folder / "ego_pose" / f"{number:03d}.txt", recording.world_from_ego[step])
    for sweep in recording.sweeps:
        pose = recording.world_from_ego[sweep.step]
        write_layout_file(folder / "lidar" / f"{numbers[sweep.step]:03d}.bin", _pack_points(sweep, pose))
    _write_boxes(recording, folder / "instances", numbers)
    return folder


def _list_intrinsics(lens: Lens) -> np.ndarray:
    """List fx, fy, cx, cy, k1, k2, p1, p2, k3."""
    k1, k2, k3 = (*lens.distortion.radial, 0.0, 0.0, 0.0)[:3]
    camera = lens.camera
    return np.array([camera.fx, camera.fy, camera.cx, camera.cy, k1, k2, *lens.distortion.tangential, k3])


def _pack_points(sweep: RecordedSweep, world_from_ego: np.ndarray) -> bytes:
    """Pack point, intensity and laser of each row, in the car's frame."""
    loaded, inverse = sweep.load(), invert_pose(world_from_ego)
    points = loaded.points @ inverse[:3, :3].T + inverse[:3, 3]
    return np.column_stack([points, loaded.intensity * 255, loaded.sensor]).astype("<f4").tobytes()


def _write_boxes(recording: Recording, folder: Path, numbers: dict[int, int]) -> None:
    found: dict[int, dict[str, list[object]]] = {}
    present: dict[str, list[int]] = {str(number): [] for number in numbers.values()}
    for step, boxes in sorted(list_boxes(recording).items()):
        for place, track, pose in boxes:
            listed = found.setdefault(place, {"frame_idx": [], "obj_to_world": [], "box_size": []})
            listed["frame_idx"].append(numbers[step])
            listed["obj_to_world"].append(pose.tolist())
            listed["box_size"].append(track.dimensions.tolist())
    ranks = {place: rank for rank, place in enumerate(sorted(found))}
    info = {}
    for place, listed in found.items():
        track = recording.tracks[place]
        info[str(ranks[place])] = {"id": track.id, "class_name": track.label, "frame_annotations": listed}
        for number in listed["frame_idx"]:
            present[str(number)].append(ranks[place])
    write_json_file(folder / "instances_info.json", info)
    write_json_file(folder / "frame_instances.json", present)
