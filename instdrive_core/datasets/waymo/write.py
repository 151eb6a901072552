"""Writes a recording as a segment of the Waymo Open Dataset, version 2."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32, Float64
from numpy import ndarray

from instdrive_core.datasets.layout_files import (
    encode_jpeg,
    find_level_heading,
    list_boxes,
    place_cameras,
    require_new_folder,
)
from instdrive_core.datasets.recording import Pose, RecordedSweep, Recording
from instdrive_core.datasets.rig_files import CAR_FROM_OPENCV, invert_pose
from instdrive_core.datasets.waymo.columns import (
    BEAM_LIMITS,
    BEAMS,
    BOX,
    BOX_TYPE,
    CAMERA,
    CAMERA_PLACE,
    CAR_POSE,
    IMAGE,
    IMAGE_POSE,
    IMAGE_TIME,
    LASER,
    LASER_PLACE,
    LENS,
    OBJECT,
    PIXEL_POSES,
    RETURNS,
    SEGMENT,
    SIZE,
    TIME,
    TOP,
)
from instdrive_core.datasets.waymo.range_images import (
    build_turns,
    compute_beam_inclinations,
    compute_pixel_directions,
    list_turn_angles,
)

ROWS = 64
"""Beams of the roof LiDAR."""
_LIMITS = (-0.31, 0.05)
"""Lowest and highest inclination in radians."""
_NEAREST = 0.1
"""Metres: a smaller range would read as no return."""
_PLACE = np.array([[1.0, 0, 0, 1.4], [0, 1, 0, 0], [0, 0, 1, 2.2], [0, 0, 0, 1]])
"""Car from roof LiDAR."""
_KINDS = (("pedestrian", 2), ("person", 2), ("cyclist", 4), ("bicycle", 4), ("sign", 3))


def write_waymo(recording: Recording, folder: Path) -> Path:
    """Write a recording as a segment. The world is moved so that the car starts at its origin.

    A range image has no place for points between its beams: each point takes the next free pixel in its column, and
    the pixel's own pose of the car takes up the difference, so that points read back as they were. Labels become
    Waymo's four types. Returns the folder and segment to open. Raises DataError where the folder is not empty.
    """
    require_new_folder(folder)
    root, times = folder / "training", {step: round(time * 1e6) for step, time in recording.step_times.items()}
    start = recording.world_from_ego[min(recording.world_from_ego)][:3, 3].round()
    segment = "".join(sign if sign.isalnum() else "_" for sign in recording.name) or "segment"
    car = {step: _shift(recording.world_from_ego[step], start) for step in sorted(times)}

    def write(component: str, columns: dict[str, Any]) -> None:
        rows = len(next(iter(columns.values())))
        _write_parquet(root / component / f"{segment}.parquet", {SEGMENT: [segment] * rows} | columns)

    write("vehicle_pose", {TIME: [times[step] for step in car], CAR_POSE: [_flatten(pose) for pose in car.values()]})
    _write_cameras(recording, times, start, write)
    write(
        "lidar_calibration",
        {LASER: [TOP], LASER_PLACE: [_flatten(_PLACE)], BEAM_LIMITS[0]: [_LIMITS[0]], BEAM_LIMITS[1]: [_LIMITS[1]]}
        | {BEAMS: [compute_beam_inclinations(*_LIMITS, ROWS).tolist()]},
    )
    images = [_draw_range_image(sweep, start, car[sweep.step]) for sweep in recording.sweeps]
    keys = {TIME: [times[sweep.step] for sweep in recording.sweeps], LASER: [TOP] * len(images)}
    if images:
        second = {f"{RETURNS[1]}.{part}": [None] * len(images) for part in ("values", "shape")}
        write("lidar", keys | _list_images(RETURNS[0], [image for image, _ in images]) | second)
        write("lidar_pose", keys | _list_images(PIXEL_POSES, [poses for _, poses in images]))
    _write_boxes(recording, times, write)
    return root / segment


def _shift(pose: Pose, start: Float64[ndarray, "3"]) -> Pose:
    moved = pose.copy()
    moved[:3, 3] -= start
    return moved


def _flatten(pose: Pose) -> list[float]:
    return pose.ravel().tolist()


def _write_cameras(recording: Recording, times: dict[int, int], start: ndarray, write: Any) -> None:
    placed = place_cameras(recording)
    numbers = {name: rank + 1 for rank, name in enumerate(recording.lenses)}
    calibration: dict[str, Any] = {name: [] for name in (CAMERA, CAMERA_PLACE, *LENS, *SIZE)}
    for name, pose in placed.items():
        lens, camera = recording.lenses[name], recording.lenses[name].camera
        k = (*lens.distortion.radial, 0.0, 0.0, 0.0)
        values = (camera.fx, camera.fy, camera.cx, camera.cy, k[0], k[1], *lens.distortion.tangential, k[2])
        row = dict(zip(LENS, values, strict=True)) | dict(zip(SIZE, (camera.width, camera.height), strict=True))
        row |= {CAMERA: numbers[name], CAMERA_PLACE: _flatten(pose @ CAR_FROM_OPENCV.T)}
        for column, value in row.items():
            calibration[column].append(value)
    write("camera_calibration", calibration)
    poses = [photo.world_from_camera @ invert_pose(placed[photo.camera]) for photo in recording.photos]
    columns = {
        TIME: [times[photo.step] for photo in recording.photos],
        CAMERA: [numbers[photo.camera] for photo in recording.photos],
        IMAGE: [encode_jpeg(photo) for photo in recording.photos],
        IMAGE_POSE: [_flatten(_shift(pose, start)) for pose in poses],
        IMAGE_TIME: [photo.time for photo in recording.photos],
    }
    write("camera_image", columns)


def _draw_range_image(
    sweep: RecordedSweep, start: Float64[ndarray, "3"], world_from_car: Pose
) -> tuple[Float32[ndarray, "r c 4"], Float32[ndarray, "r c 6"]]:
    """The range image of a sweep, and the pose of the car for each of its pixels."""
    loaded = sweep.load()
    points, bright = loaded.points - start, loaded.intensity
    inverse = invert_pose(world_from_car @ _PLACE)
    local = points @ inverse[:3, :3].T + inverse[:3, 3]
    order = np.argsort(-np.arctan2(local[:, 1], local[:, 0]), kind="stable")
    columns = max(-(-len(points) // ROWS), 1)
    rises = np.arctan2(local[:, 2], np.hypot(local[:, 0], local[:, 1]))
    rows, places = np.zeros(len(points), int), np.zeros(len(points), int)
    for column in range(columns):
        members = order[column * ROWS : (column + 1) * ROWS]
        members = members[np.argsort(-rises[members], kind="stable")]
        rows[members], places[members] = np.arange(len(members)), column
    image, poses = np.zeros((ROWS, columns, 4), np.float32), np.zeros((ROWS, columns, 6), np.float32)
    image[rows, places, 0] = np.maximum(np.linalg.norm(local, axis=1), _NEAREST)
    image[rows, places, 1] = bright
    poses[:, :, :3] = list_turn_angles(world_from_car[:3, :3])
    beams = compute_beam_inclinations(*_LIMITS, ROWS)
    rays = compute_pixel_directions(beams, columns, _PLACE)[rows, places] * image[rows, places, 0][:, None]
    turns = build_turns(poses[rows, places, :3].astype(np.float64))
    shown = np.einsum("nij,nj->ni", turns, rays @ _PLACE[:3, :3].T + _PLACE[:3, 3])
    poses[rows, places, 3:] = points - shown
    return image, poses


def _list_images(name: str, images: list[ndarray]) -> dict[str, Any]:
    return {f"{name}.values": [image.ravel() for image in images], f"{name}.shape": [list(i.shape) for i in images]}


def _write_boxes(recording: Recording, times: dict[int, int], write: Any) -> None:
    columns: dict[str, Any] = {name: [] for name in (TIME, OBJECT, BOX_TYPE, *BOX)}
    for step, boxes in sorted(list_boxes(recording).items()):
        inverse = invert_pose(recording.world_from_ego[step])
        for _, track, pose in boxes:
            width, length, height = track.dimensions.tolist()
            heading = find_level_heading(inverse[:3, :3].T, pose[:3, 1], (0, 1))
            yaw = float(np.arctan2(heading[1], heading[0]))
            values = (*(inverse @ pose)[:3, 3].tolist(), length, width, height, yaw)
            row = dict(zip(BOX, values, strict=True))
            kind = next((kind for word, kind in _KINDS if word in track.label.lower()), 1)
            for name, value in (row | {TIME: times[step], OBJECT: track.id, BOX_TYPE: kind}).items():
                columns[name].append(value)
    write("lidar_box", columns)


def _write_parquet(file: Path, columns: dict[str, Any]) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    kinds: dict[str, Any] = {SEGMENT: pa.string(), OBJECT: pa.string(), IMAGE: pa.binary(), TIME: pa.int64()}
    kinds |= {CAMERA: pa.int8(), LASER: pa.int8(), BOX_TYPE: pa.int8(), SIZE[0]: pa.int32(), SIZE[1]: pa.int32()}

    def choose(name: str) -> Any:
        if name in kinds:
            return kinds[name]
        if name.endswith(".transform") or name == BEAMS:
            return pa.list_(pa.float64())
        lists = {".values": pa.list_(pa.float32()), ".shape": pa.list_(pa.int32())}
        return next((kind for ending, kind in lists.items() if name.endswith(ending)), pa.float64())

    table = pa.table({name: pa.array(values, choose(name)) for name, values in columns.items()})
    file.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(table, str(file), row_group_size=16)
