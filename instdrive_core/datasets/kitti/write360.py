"""Writes the first camera of a recording as KITTI-360 stores its left one, with LiDAR and boxes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from instdrive_core.datasets.kitti.numbers import format_time
from instdrive_core.datasets.layout_files import (
    encode_png,
    list_boxes,
    number_steps,
    place_cameras,
    require_new_folder,
    write_layout_file,
    write_matrix,
)
from instdrive_core.datasets.recording import Pose, Recording
from instdrive_core.datasets.rig_files import FORWARD_X, invert_pose
from instdrive_core.errors import DataError

DRIVE = "2013_05_28_drive_0000_sync"
_CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
_VELODYNE_FROM_CAMERA = np.array([[0.0, 0, 1, 0.8], [-1, 0, 0, 0.3], [0, -1, 0, -0.2], [0, 0, 0, 1]])
_LABELS = (("pedestrian", "person"), ("person", "person"), ("truck", "truck"), ("bus", "bus"), ("bicycle", "bicycle"))


def write_kitti360(recording: Recording, folder: Path) -> Path:
    """Write the first camera, the LiDAR and the boxes of a recording as a drive of KITTI-360.

    Lens distortion is not written; labels become ``car`` where KITTI-360 has no like one. Every box is written as that
    of a moving object. Returns the folder to open. Raises DataError where the folder is not empty or the first camera
    has no photo.
    """
    name = next(iter(recording.lenses))
    photos = {photo.step: photo for photo in recording.photos if photo.camera == name}
    if not photos:
        raise DataError(recording.root, f"{name} has no photo, and the layout holds only that camera", "Choose others")
    require_new_folder(folder)
    pose_from_camera = place_cameras(recording)[name]
    poses = {step: photo.world_from_camera @ invert_pose(pose_from_camera) for step, photo in photos.items()}
    numbers = {step: number for step, number in number_steps(recording).items() if step in poses}
    camera, calibration = recording.lenses[name].camera, folder / "calibration"
    projection = f"{camera.fx!r} 0 {camera.cx!r} 0 0 {camera.fy!r} {camera.cy!r} 0 0 0 1 0"
    perspective = f"S_rect_00: {camera.width} {camera.height}\nR_rect_00: 1 0 0 0 1 0 0 0 1\nP_rect_00: {projection}\n"
    write_layout_file(calibration / "perspective.txt", perspective.encode())
    placed = f"image_00: {_join(pose_from_camera[:3])}\n"
    write_layout_file(calibration / "calib_cam_to_pose.txt", placed.encode())
    write_matrix(calibration / "calib_cam_to_velo.txt", _VELODYNE_FROM_CAMERA[:3].reshape(1, 12))
    photos_folder = folder / "data_2d_raw" / DRIVE / "image_00"
    for step, number in numbers.items():
        write_layout_file(photos_folder / "data_rect" / f"{number:010d}.png", encode_png(photos[step]))
    times = {number: recording.step_times[step] for step, number in number_steps(recording).items()}
    lines = [format_time(times[number]) for number in sorted(times)]
    write_layout_file(photos_folder / "timestamps.txt", ("\n".join(lines) + "\n").encode())
    rows = [f"{number} {_join(poses[step][:3])}" for step, number in numbers.items()]
    write_layout_file(folder / "data_poses" / DRIVE / "poses.txt", ("\n".join(rows) + "\n").encode())
    for sweep in recording.sweeps:
        if sweep.step in poses:
            inverse = _VELODYNE_FROM_CAMERA @ invert_pose(poses[sweep.step] @ pose_from_camera)
            loaded = sweep.load()
            points = loaded.points @ inverse[:3, :3].T + inverse[:3, 3]
            file = folder / "data_3d_raw" / DRIVE / "velodyne_points" / "data" / f"{numbers[sweep.step]:010d}.bin"
            write_layout_file(file, np.column_stack([points, loaded.intensity]).astype("<f4").tobytes())
    boxes = _describe_boxes(recording, numbers)
    write_layout_file(folder / "data_3d_bboxes" / "train" / f"{DRIVE}.xml", boxes.encode())
    return photos_folder.parent


def _join(values: np.ndarray) -> str:
    return " ".join(map(repr, values.ravel().tolist()))


def _describe_boxes(recording: Recording, numbers: dict[int, int]) -> str:
    nodes = []
    for step, boxes in sorted(list_boxes(recording).items()):
        for place, track, pose in boxes if step in numbers else ():
            label = next((label for word, label in _LABELS if word in track.label.lower()), "car")
            matrix = pose @ FORWARD_X.T @ np.diag([*track.dimensions[[1, 0, 2]], 1])
            head = {"index": len(nodes), "label": label, "semanticId": 26, "instanceId": place}
            head |= {"start_frame": numbers[step], "end_frame": numbers[step], "timestamp": numbers[step], "dynamic": 1}
            fields = "".join(f"<{key}>{value}</{key}>" for key, value in head.items())
            matrices = _describe_matrix("transform", matrix) + _describe_matrix("vertices", _CORNERS)
            nodes.append(f"<object{len(nodes) + 1}>{fields}{matrices}</object{len(nodes) + 1}>\n")
    return f'<?xml version="1.0"?>\n<opencv_storage>\n{"".join(nodes)}</opencv_storage>\n'


def _describe_matrix(name: str, matrix: Pose | np.ndarray) -> str:
    rows, columns = matrix.shape
    size = f"<rows>{rows}</rows><cols>{columns}</cols><dt>d</dt>"
    return f'<{name} type_id="opencv-matrix">{size}<data>{_join(matrix)}</data></{name}>'
