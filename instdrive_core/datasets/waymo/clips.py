"""Segments of the Waymo Open Dataset, version 2: ``training/SEGMENT``, whose tables lie in folders by component.

Conventions as in its package: world from car, car from sensor; the car has x forward, y left, z up, and so have the
cameras; boxes are in the car's frame; the roof LiDAR's points are placed by the car's pose at each pixel.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.datasets.arrow_tables import (
    locate_rows,
    read_parquet_group,
    take_integers,
    take_lists,
    take_numbers,
    take_texts,
)
from instdrive_core.datasets.clip import Clip, ClipOptions
from instdrive_core.datasets.distortion import Distortion
from instdrive_core.datasets.posed_photos import build_camera
from instdrive_core.datasets.recorded_clips import build_recorded_clip
from instdrive_core.datasets.recording import Lens, Pose, RecordedPhoto, RecordedPoints, RecordedSweep, Recording
from instdrive_core.datasets.rig_files import CAR_FROM_OPENCV, FARTHEST, FORWARD_X, require_pose, require_sizes
from instdrive_core.datasets.waymo.columns import (
    BEAM_LIMITS,
    BEAMS,
    BOX,
    BOX_TYPE,
    CAMERA,
    CAMERA_PLACE,
    CAMERAS,
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
    SIZE,
    TIME,
    TOP,
    TYPES,
)
from instdrive_core.datasets.waymo.range_images import build_turns, compute_beam_inclinations, compute_pixel_directions
from instdrive_core.errors import DataError
from instdrive_core.scene.track import Track

_REMEDY = "Get the file again"
_MOST_PIXELS = 1 << 24


@dataclass(frozen=True)
class _Segment:
    """Where a segment's tables are."""

    root: Path
    name: str

    def file(self, component: str) -> Path:
        return self.root / component / f"{self.name}.parquet"


@dataclass(frozen=True)
class _Laser:
    """A LiDAR on the car."""

    car_from_laser: Pose
    limits: tuple[float, float]
    beams: Float64[ndarray, " r"] | None
    """Inclinations in radians, the lowest first; None where they are spread evenly."""


def holds_waymo(path: str | Path) -> bool:
    """Whether the path names a segment whose photos are there, or a folder that holds those of one segment."""
    return _find_segment(Path(path)) is not None


def _find_segment(path: Path) -> _Segment | None:
    if (path.parent / "camera_image" / f"{path.name}.parquet").is_file():
        return _Segment(path.parent, path.name)
    found = sorted((path / "camera_image").glob("*.parquet"))
    return _Segment(path, found[0].stem) if len(found) == 1 else None


def load_waymo(path: str | Path, options: ClipOptions) -> Clip:
    """Open a segment of the Waymo Open Dataset, e.g. ``training/10017090168044687777_6380_000_6400_000``.

    Raises DataError where a file is missing or damaged, OptionError for options that do not fit.
    """
    segment = _find_segment(Path(path))
    if segment is None:
        raise DataError(path, "names no segment whose 'camera_image' is there", "Give the folder and a segment's name")
    return build_recorded_clip(_read_segment(Path(path), segment), options)


def _read_segment(path: Path, segment: _Segment) -> Recording:
    car = _read_car_poses(segment.file("vehicle_pose"))
    moments = sorted(car)
    steps = {time: step for step, time in enumerate(moments)}
    photos, used = _list_photos(segment, steps)
    lidar = segment.file("lidar")
    boxes = segment.file("lidar_box")
    return Recording(
        root=path,
        name=segment.name,
        lenses=_read_lenses(segment.file("camera_calibration"), used),
        step_times={step: time * 1e-6 for time, step in steps.items()},
        photos=photos,
        sweeps=_list_sweeps(segment, steps, car) if lidar.is_file() else (),
        tracks=_read_tracks(boxes, car) if boxes.is_file() else (),
        world_from_ego={steps[time]: pose for time, pose in car.items()},
    )


def _read_transform(file: Path, table: object, name: str, row: int) -> Pose:
    values = take_lists(file, table, name, row)
    if values is None or len(values) != 16:
        raise DataError(file, f"the column '{name}' holds no 4×4 numbers in row {row}", _REMEDY)
    return require_pose(file, values.reshape(4, 4), f"row {row} of '{name}'")


def _read_car_poses(file: Path) -> dict[int, Pose]:
    table = read_parquet_group(file, (TIME, CAR_POSE))
    times = take_integers(file, table, TIME).tolist()
    if not times:
        raise DataError(file, "holds no pose", _REMEDY)
    return {time: _read_transform(file, table, CAR_POSE, row) for row, time in enumerate(times)}


def _name_camera(number: int) -> str:
    return CAMERAS[number - 1] if 0 < number <= len(CAMERAS) else f"CAMERA_{number}"


def _list_photos(segment: _Segment, steps: dict[int, int]) -> tuple[tuple[RecordedPhoto, ...], list[int]]:
    """The photos, and the numbers of their cameras."""
    file = segment.file("camera_image")
    places = {
        number: _read_transform(segment.file("camera_calibration"), table, CAMERA_PLACE, row) @ CAR_FROM_OPENCV
        for table in [read_parquet_group(segment.file("camera_calibration"), (CAMERA, CAMERA_PLACE))]
        for row, number in enumerate(take_integers(segment.file("camera_calibration"), table, CAMERA).tolist())
    }
    table = read_parquet_group(file, (TIME, CAMERA, IMAGE_POSE, IMAGE_TIME))
    times, cameras = take_integers(file, table, TIME).tolist(), take_integers(file, table, CAMERA).tolist()
    exposed = take_numbers(file, table, (IMAGE_TIME,))[:, 0]
    rows = locate_rows(file)
    if len(rows) != len(times):
        raise DataError(file, f"promises {len(rows)} rows and holds {len(times)}", _REMEDY)
    photos: dict[tuple[int, int], RecordedPhoto] = {}
    for row, (time, number) in enumerate(zip(times, cameras, strict=True)):
        if time not in steps or number not in places:
            raise DataError(file, f"row {row}: there is no pose at {time} or no camera {number}", _REMEDY)
        pose = _read_transform(file, table, IMAGE_POSE, row) @ places[number]
        photos[steps[time], number] = RecordedPhoto(
            _name_camera(number), steps[time], float(exposed[row]), pose, file, partial(_open_image, file, *rows[row])
        )
    return tuple(photos.values()), sorted({number for _, number in photos})


def _open_image(file: Path, group: int, row: int) -> io.BufferedIOBase:
    images = _read_images(file, group, file.stat().st_mtime_ns)
    content = images[row] if row < len(images) else None
    if not isinstance(content, bytes):
        raise DataError(file, f"row {row} of group {group} holds no photo", _REMEDY)
    return io.BytesIO(content)


@lru_cache(maxsize=2)
def _read_images(file: Path, group: int, changed: int) -> list[bytes | None]:
    """The encoded photos of one group of rows, kept until the file changes: neighbours are asked for next."""
    return read_parquet_group(file, (IMAGE,), group).column(IMAGE).to_pylist()


def _read_lenses(file: Path, used: list[int]) -> dict[str, Lens]:
    table = read_parquet_group(file, (CAMERA, *LENS, *SIZE))
    numbers = take_integers(file, table, CAMERA).tolist()
    values = take_numbers(file, table, (*LENS, *SIZE))
    lenses = {}
    for number in used:
        fx, fy, cx, cy, k1, k2, p1, p2, k3, width, height = map(float, values[numbers.index(number)])
        size = int(np.clip(width, 0, 1e9)), int(np.clip(height, 0, 1e9))
        camera = build_camera(file, f"camera {number}", (fx, fy, cx, cy), size)
        lenses[_name_camera(number)] = Lens(camera, Distortion((k1, k2, k3), (p1, p2)))
    return lenses


def _list_sweeps(segment: _Segment, steps: dict[int, int], car: dict[int, Pose]) -> tuple[RecordedSweep, ...]:
    file = segment.file("lidar")
    lasers = _read_lasers(segment.file("lidar_calibration"))
    table = read_parquet_group(file, (TIME, LASER))
    rows: dict[int, dict[int, int]] = {}
    pairs = zip(take_integers(file, table, TIME).tolist(), take_integers(file, table, LASER).tolist(), strict=True)
    for row, (time, laser) in enumerate(pairs):
        if time not in steps or laser not in lasers:
            raise DataError(file, f"row {row}: there is no pose at {time} or no calibration of LiDAR {laser}", _REMEDY)
        rows.setdefault(time, {})[laser] = row
    return tuple(
        RecordedSweep(
            steps[time],
            time * 1e-6,
            car[time] @ lasers.get(TOP, next(iter(lasers.values()))).car_from_laser,
            partial(_load_points, segment, time, found, lasers, car[time]),
        )
        for time, found in sorted(rows.items())
    )


def _read_lasers(file: Path) -> dict[int, _Laser]:
    table = read_parquet_group(file, (LASER, LASER_PLACE, *BEAM_LIMITS, BEAMS))
    limits = take_numbers(file, table, BEAM_LIMITS)
    return {
        laser: _Laser(
            _read_transform(file, table, LASER_PLACE, row),
            (float(limits[row, 0]), float(limits[row, 1])),
            take_lists(file, table, BEAMS, row),
        )
        for row, laser in enumerate(take_integers(file, table, LASER).tolist())
    }


def _load_points(
    segment: _Segment, time: int, rows: dict[int, int], lasers: dict[int, _Laser], world_from_car: Pose
) -> RecordedPoints:
    file = segment.file("lidar")
    places = locate_rows(file)
    points, intensity, sensor = [np.zeros((0, 3))], [np.zeros(0)], [np.zeros(0, np.uint8)]
    for laser, row in sorted(rows.items()):
        poses = _read_pixel_poses(segment.file("lidar_pose"), time, laser)
        for name in RETURNS:
            image = _read_range_image(file, name, *places[row], 4)
            if image is not None:
                found = _place_pixels(file, image, lasers[laser], poses, world_from_car)
                points.append(found[0])
                intensity.append(found[1])
                sensor.append(np.full(len(found[0]), min(max(laser - 1, 0), 255), np.uint8))
    together = np.concatenate(points)
    wrong = np.flatnonzero(~(np.abs(together) < FARTHEST).all(axis=1))
    if len(wrong):
        raise DataError(file, f"a point lies at {together[wrong[0]].tolist()}", _REMEDY)
    bright = np.clip(np.concatenate(intensity), 0, 1).astype(np.float32)
    return RecordedPoints(together, bright, np.concatenate(sensor))


def _read_range_image(file: Path, name: str, group: int, row: int, channels: int) -> Float64[ndarray, "r c k"] | None:
    """An image of numbers; None where the row has none."""
    table = _read_images_of_numbers(file, name, group, file.stat().st_mtime_ns)
    values, shape = (take_lists(file, table, f"{name}.{part}", row) for part in ("values", "shape"))
    if values is None or shape is None or not len(values):
        return None
    is_image = len(shape) == 3 and shape[2] == channels and (shape > 0).all() and shape[0] * shape[1] <= _MOST_PIXELS
    if not is_image or len(values) != int(np.prod(shape)):
        problem = f"'{name}' has {len(values)} numbers and the shape {shape.tolist()} in row {row}"
        raise DataError(file, problem, _REMEDY)
    return values.reshape([int(side) for side in shape])


@lru_cache(maxsize=4)
def _read_images_of_numbers(file: Path, name: str, group: int, changed: int) -> object:
    """The range images of one group of rows, kept until the file changes: neighbours are asked for next."""
    return read_parquet_group(file, (f"{name}.values", f"{name}.shape"), group)


def _read_pixel_poses(file: Path, time: int, laser: int) -> Float64[ndarray, "r c 6"] | None:
    """World from car for each pixel: roll, pitch, yaw, x, y, z; None where nothing says so."""
    known = _list_pixel_poses(file, file.stat().st_mtime_ns) if file.is_file() else {}
    place = known.get((time, laser))
    return None if place is None else _read_range_image(file, PIXEL_POSES, *place, 6)


@lru_cache(maxsize=2)
def _list_pixel_poses(file: Path, changed: int) -> dict[tuple[int, int], tuple[int, int]]:
    table = read_parquet_group(file, (TIME, LASER))
    keys = zip(take_integers(file, table, TIME).tolist(), take_integers(file, table, LASER).tolist(), strict=True)
    return dict(zip(keys, locate_rows(file), strict=False))


def _place_pixels(
    file: Path,
    image: Float64[ndarray, "r c 4"],
    laser: _Laser,
    poses: Float64[ndarray, "r c 6"] | None,
    world_from_car: Pose,
) -> tuple[Float64[ndarray, "n 3"], Float64[ndarray, " n"]]:
    """Points in the world and intensities of the pixels that have a return."""
    beams = compute_beam_inclinations(*laser.limits, len(image)) if laser.beams is None else laser.beams
    if len(beams) != len(image) or (poses is not None and poses.shape[:2] != image.shape[:2]):
        problem = f"a range image of {image.shape[0]}×{image.shape[1]} does not fit {len(beams)} beams or its poses"
        raise DataError(file, problem, _REMEDY)
    seen = image[:, :, 0] > 0
    rays = compute_pixel_directions(beams, image.shape[1], laser.car_from_laser)[seen]
    place = laser.car_from_laser
    local = (rays * image[:, :, 0][seen][:, None]) @ place[:3, :3].T + place[:3, 3]
    if poses is None:
        return local @ world_from_car[:3, :3].T + world_from_car[:3, 3], image[:, :, 1][seen]
    pixel = poses[seen]
    return np.einsum("nij,nj->ni", build_turns(pixel[:, :3]), local) + pixel[:, 3:], image[:, :, 1][seen]


def _read_tracks(file: Path, car: dict[int, Pose]) -> tuple[Track, ...]:
    table = read_parquet_group(file, (TIME, OBJECT, BOX_TYPE, *BOX))
    times, known = take_integers(file, table, TIME).tolist(), take_texts(file, table, OBJECT)
    kinds, values = take_integers(file, table, BOX_TYPE).tolist(), take_numbers(file, table, BOX)
    rows_of: dict[str, dict[int, int]] = {}
    for row, (name, time) in enumerate(zip(known, times, strict=True)):
        if time not in car:
            raise DataError(file, f"row {row}: there is no pose at {time}", _REMEDY)
        if not np.abs(values[row, :3]).max() < FARTHEST:
            raise DataError(file, f"row {row} lies at {values[row, :3].tolist()}", _REMEDY)
        require_sizes(file, values[row, 3:6], f"row {row}")
        rows_of.setdefault(name, {})[time] = row
    tracks = []
    for name, rows in rows_of.items():
        ordered = sorted(rows)
        boxes = values[[rows[time] for time in ordered]]
        poses = np.stack([car[time] @ _place_box(box) @ FORWARD_X for time, box in zip(ordered, boxes, strict=True)])
        length, width, height = np.median(boxes[:, 3:6], axis=0)
        kind = kinds[rows[ordered[0]]]
        label = TYPES[kind] if 0 <= kind < len(TYPES) else f"type {kind}"
        tracks.append(Track(name, label, np.array([width, length, height]), np.array(ordered) * 1e-6, poses))
    return tuple(tracks)


def _place_box(box: Float64[ndarray, "7"]) -> Pose:
    """Car from box, x forward."""
    pose = np.eye(4)
    cosine, sine = np.cos(box[6]), np.sin(box[6])
    pose[:2, :2] = [[cosine, -sine], [sine, cosine]]
    pose[:3, 3] = box[:3]
    return pose
