"""Drives of KITTI-360, opened by their photos: ``data_2d_raw/2013_05_28_drive_0003_sync``.

What belongs to them lies above: ``calibration``, ``data_poses``, ``data_3d_raw`` and ``data_3d_bboxes``. Conventions as
in kitti360Scripts: poses are world from IMU, the world's z up; ``calib_cam_to_pose`` places the cameras before they are
turned by ``R_rect``; boxes are a transform of a unit cube, x forward: one an object that stands, one a frame of others.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.datasets.clip import Clip, ClipOptions
from instdrive_core.datasets.fisheye import Fisheye
from instdrive_core.datasets.kitti.numbers import (
    read_named_numbers,
    read_times,
    require_matrix,
    require_rotation,
    require_transform,
)
from instdrive_core.datasets.kitti.rig import list_counted_files, list_sweeps
from instdrive_core.datasets.photos import read_photo_size
from instdrive_core.datasets.posed_photos import build_camera
from instdrive_core.datasets.recorded_clips import build_recorded_clip
from instdrive_core.datasets.recording import Lens, Pose, RecordedPhoto, Recording, open_photo_file
from instdrive_core.datasets.rig_files import (
    FORWARD_X,
    invert_pose,
    parse_numbers,
    read_number_text,
    require_pose,
    require_sizes,
)
from instdrive_core.errors import DataError
from instdrive_core.files.json_value import require_whole_text
from instdrive_core.files.text_file import read_text
from instdrive_core.files.xml_file import parse_xml, read_child_text
from instdrive_core.scene.track import Track

CAMERAS = {"image_00": "data_rect", "image_01": "data_rect", "image_02": "data_rgb", "image_03": "data_rgb"}
"""Folders of the photos by camera. The last two are fisheye cameras, to the left and to the right."""
_OBJECTS = (
    *("bicycle", "box", "bus", "car", "caravan", "motorcycle", "person", "rider", "smallPole", "trailer", "train"),
    *("trashbin", "truck", "unknownObject", "unknownVehicle", "vendingmachine"),
)
"""Labels of things that a box describes well; the others are meshes of ground, walls and plants."""
_UPRIGHT = np.diag([1.0, -1.0, -1.0, 1.0])
"""Axes of the IMU (x forward, y right, z down) from the car's."""
_REMEDY = "Get the file again"


def holds_kitti360(path: str | Path) -> bool:
    """Whether the folder holds the photos of a drive whose calibration and poses lie where KITTI-360 has them."""
    root = Path(path).resolve()
    above = root.parent.parent
    has_photos = any((root / name / folder).is_dir() for name, folder in CAMERAS.items())
    return has_photos and (above / "calibration").is_dir() and (above / "data_poses" / root.name).is_dir()


def load_kitti360(path: str | Path, options: ClipOptions) -> Clip:
    """Open a drive of KITTI-360.

    Raises DataError where a file is missing or damaged, OptionError for options that do not fit.
    """
    return build_recorded_clip(read_kitti360(Path(path)), options)


def read_kitti360(root: Path) -> Recording:
    """Read poses, lenses and boxes of a drive; photos and sweeps when asked for."""
    data, name = root.resolve().parent.parent, root.resolve().name
    listed = {camera: list_counted_files(root / camera / folder, ".png") for camera, folder in CAMERAS.items()}
    cameras = {camera: files for camera, files in listed.items() if files}
    if not cameras:
        raise DataError(root, "holds no photo such as image_00/data_rect/0000000250.png", "Get the drive's photos")
    poses = _read_poses(data / "data_poses" / name / "poses.txt")
    first = next(iter(cameras))
    times = read_times(root / first / "timestamps.txt")
    known = {step: times[step] for step in sorted(poses) if step < len(times)}
    poses = {step: poses[step] for step in known}
    places, lenses = _read_rig(data / "calibration", cameras)
    unposed = sum(step not in poses for files in cameras.values() for step in files)
    boxes = _find_boxes(data / "data_3d_bboxes", name)
    notes = (f"{unposed} photos without a pose are left out",) if unposed else ()
    photos = tuple(
        RecordedPhoto(camera, step, known[step], poses[step] @ places[camera], file, open_photo_file(file))
        for camera, files in cameras.items()
        for step, file in files.items()
        if step in poses
    )
    velodyne = list_counted_files(data / "data_3d_raw" / name / "velodyne_points" / "data", ".bin")
    sweeps = list_sweeps(velodyne, poses, _place_velodyne(data / "calibration"), known) if velodyne else ()
    return Recording(
        root=root,
        name=name,
        lenses=lenses,
        step_times=known,
        photos=photos,
        sweeps=sweeps,
        tracks=() if boxes is None else _read_tracks(boxes, known),
        world_from_ego={step: pose if pose[2, 2] > 0 else pose @ _UPRIGHT for step, pose in poses.items()},
        notes=notes,
    )


def _read_poses(file: Path) -> dict[int, Pose]:
    poses = {}
    for row, line in enumerate(read_text(file).splitlines()):
        values = parse_numbers(file, line.split(), f"line {row + 1}")
        if len(values) not in (0, 13) or (len(values) and (values[0] < 0 or values[0] != int(values[0]))):
            raise DataError(file, f"line {row + 1} is no step and 3×4 numbers", _REMEDY)
        if len(values):
            poses[int(values[0])] = require_pose(file, values[1:].reshape(3, 4), f"line {row + 1}")
    if not poses:
        raise DataError(file, "holds no pose", _REMEDY)
    return poses


def _read_rig(folder: Path, cameras: dict[str, dict[int, Path]]) -> tuple[dict[str, Pose], dict[str, Lens]]:
    """IMU from each rectified camera, and its lens."""
    file, between = folder / "perspective.txt", folder / "calib_cam_to_pose.txt"
    rectified = any(CAMERAS[name] == "data_rect" for name in cameras)
    found, placed = read_named_numbers(file) if rectified else {}, read_named_numbers(between)
    places, lenses = {}, {}
    for name, files in cameras.items():
        size = read_photo_size(next(iter(files.values())))
        if CAMERAS[name] == "data_rgb":
            places[name] = require_transform(between, placed, (name,))
            lenses[name] = _read_fisheye(folder / f"{name}.yaml", name, size)
            continue
        turn = require_rotation(file, found, (f"R_rect_{name[-2:]}",))
        places[name] = require_transform(between, placed, (name,)) @ invert_pose(turn)
        matrix = require_matrix(file, found, (f"P_rect_{name[-2:]}",), (3, 4))
        intrinsics = (float(matrix[0, 0]), float(matrix[1, 1]), float(matrix[0, 2]), float(matrix[1, 2]))
        lenses[name] = Lens(build_camera(file, name, intrinsics, size))
    return places, lenses


def _read_fisheye(file: Path, name: str, size: tuple[int, int]) -> Lens:
    """Mei's mirror, in the words of OpenCV's YAML."""
    found = read_named_numbers(file)

    def value(key: str) -> float:
        return float(require_matrix(file, found, (key,), (1, 1))[0, 0])

    camera = build_camera(file, name, (value("gamma1"), value("gamma2"), value("u0"), value("v0")), size)
    if not 0 <= value("xi") < 1e3:
        raise DataError(file, f"xi is {value('xi')}, expected a mirror's, 0 or above", _REMEDY)
    return Lens(camera, Fisheye((value("k1"), value("k2")), (value("p1"), value("p2")), mirror=value("xi")))


def _place_velodyne(folder: Path) -> Pose:
    """IMU from LiDAR, by camera 0 as it was before it was rectified."""
    file, between = folder / "calib_cam_to_velo.txt", folder / "calib_cam_to_pose.txt"
    velodyne_from_camera = require_pose(file, read_number_text(file, (3, 4)), "the matrix")
    return require_transform(between, read_named_numbers(between), ("image_00",)) @ invert_pose(velodyne_from_camera)


def _find_boxes(folder: Path, name: str) -> Path | None:
    files = (folder / part / f"{name}.xml" for part in ("train_full", "train", "."))
    return next((file for file in files if file.is_file()), None)


def _read_tracks(file: Path, times: dict[int, float]) -> tuple[Track, ...]:
    """A track per object: a moving one has a box a frame, a standing one the same box at both ends of its time."""
    found: dict[str, dict[int, tuple[Pose, Float64[ndarray, "3"]]]] = {}
    labels: dict[str, str] = {}
    for node in parse_xml(file):
        where = node.tag[:40]
        label = node.findtext("label", "").strip()
        if label not in _OBJECTS:
            continue
        words = [read_child_text(file, node, key, where) for key in _NUMBERS]
        semantic, instance, first, last, moment = (int(value) for value in _parse_steps(file, words, where))
        known = f"{semantic}_{instance}" if instance >= 0 else where
        pose, sizes = _read_box(file, node, where)
        steps = _choose_steps(times, first, last) if moment < 0 else [moment]
        labels.setdefault(known, require_whole_text(label))
        for step in steps:
            if step in times:
                found.setdefault(known, {})[step] = (pose @ FORWARD_X, sizes)
    return tuple(_build_track(known, labels[known], boxes, times) for known, boxes in found.items())


_NUMBERS = ("semanticId", "instanceId", "start_frame", "end_frame", "timestamp")


def _parse_steps(file: Path, words: list[str], where: str) -> Float64[ndarray, " n"]:
    values = parse_numbers(file, words, where)
    if not ((np.abs(values) < 1e12) & (values == np.round(values))).all():
        raise DataError(file, f"{where} holds {values.tolist()}, expected whole numbers", _REMEDY)
    return values


def _choose_steps(times: dict[int, float], first: int, last: int) -> list[int]:
    """The first and the last step with a pose that a standing object is seen in."""
    inside = [step for step in times if first <= step <= last]
    return sorted({inside[0], inside[-1]}) if inside else []


def _read_box(file: Path, node: ElementTree.Element, where: str) -> tuple[Pose, Float64[ndarray, "3"]]:
    """World from box, and its width, length and height."""
    matrix, vertices = _read_matrix(file, node, "transform", where), _read_matrix(file, node, "vertices", where)
    if matrix.shape != (4, 4) or vertices.ndim != 2 or vertices.shape[1] != 3 or len(vertices) < 2:
        raise DataError(file, f"{where} has no transform of 4×4 numbers or no vertices", _REMEDY)
    scales = np.linalg.norm(matrix[:3, :3], axis=0)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    sizes = scales * (high - low)
    require_sizes(file, sizes, where)
    pose = require_pose(file, np.column_stack([matrix[:3, :3] / scales, matrix[:3, 3]]), where)
    pose[:3, 3] += matrix[:3, :3] @ ((low + high) / 2)
    return pose, sizes[[1, 0, 2]]


def _read_matrix(file: Path, node: ElementTree.Element, name: str, where: str) -> Float64[ndarray, "r c"]:
    part = node.find(name)
    if part is None:
        raise DataError(file, f"the element '{where}/{name}' is missing", _REMEDY)
    rows, columns = parse_numbers(file, [read_child_text(file, part, key, where) for key in ("rows", "cols")], where)
    values = parse_numbers(file, read_child_text(file, part, "data", where).split(), f"{where}/{name}")
    if (
        not (np.abs(values) < 1e9).all()
        or not 0 < rows <= 1e6
        or not 0 < columns <= 16
        or len(values) != rows * columns
    ):
        raise DataError(file, f"{where}/{name} has {len(values)} numbers, expected {rows:g}×{columns:g}", _REMEDY)
    return values.reshape(int(rows), int(columns))


def _build_track(
    known: str, label: str, boxes: dict[int, tuple[Pose, Float64[ndarray, "3"]]], times: dict[int, float]
) -> Track:
    steps = sorted(boxes)
    dimensions = np.median([boxes[step][1] for step in steps], axis=0)
    return Track(known, label, dimensions, np.array([times[s] for s in steps]), np.stack([boxes[s][0] for s in steps]))
