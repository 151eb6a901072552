"""PandaSet's folder layout: cameras, LiDAR, cuboids and semantic classes of one sequence.

Layout and conventions follow the PandaSet devkit: poses are camera→world with wxyz quaternions and OpenCV axes, LiDAR
points are in the world. JSON files may list more time steps than there are files; whatever file is missing is left
out of the clip.

A clip has one time per step. Its photos are taken one after the other while the spinning LiDAR goes round, and cuboids
describe objects where that LiDAR met them. The photos' cameras know by how much the two differ (`PhotoLag`).
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float64
from numpy import ndarray

from instdrive_core.datasets.clip import Clip, ClipOptions, Frame, SparsePoints, Sweep, choose_origin, is_held_out
from instdrive_core.datasets.frame_range import build_range_test, describe_steps
from instdrive_core.datasets.laser_turn import add_photo_lags
from instdrive_core.datasets.pandaset.cuboids import load_tracks
from instdrive_core.datasets.pandaset.lidar import FARTHEST, load_sweep
from instdrive_core.datasets.photos import load_photo, read_photo_size
from instdrive_core.datasets.posed_photos import describe_start
from instdrive_core.errors import DataError, OptionError
from instdrive_core.files.json_fields import (
    parse_whole_number,
    read_json,
    require_field,
    require_number,
    require_numbers,
)
from instdrive_core.files.json_value import require_whole_text
from instdrive_core.maths.rotations import matrix_from_quaternion
from instdrive_core.scene.camera import Camera, CameraView

logger = logging.getLogger(__name__)

CAMERAS = ("front_camera", "front_left_camera", "front_right_camera", "left_camera", "right_camera", "back_camera")
CAMERA_SETS = {"1": CAMERAS[:1], "3": CAMERAS[:3], "6": CAMERAS}

DEFAULT_WIDTH = 480
"""Pixels to which photos are scaled where no scale is asked for."""

EGO_CAMERA, EGO_ROWS = "back_camera", 256 / 1080
"""The share of the back camera's rows, at the bottom, that show the recording car; neurad-studio crops 250 rows of
1080, which leaves the edge of the bonnet in the photo."""


@dataclass(frozen=True)
class _CameraFiles:
    """One camera of the clip: what its JSON files say, and its photos by time step."""

    name: str
    camera: Camera
    """At full size; its pose is unset."""
    poses: Float64[ndarray, "t 4 4"]
    photos: dict[int, Path]
    stamps: list[float]
    """When each photo was taken, by time step; empty where no file says so."""


def holds_pandaset(path: str | Path) -> bool:
    """Whether the folder holds photos by camera."""
    return (Path(path) / "camera").is_dir()


def load_pandaset(path: str | Path, options: ClipOptions) -> Clip:
    """Open one PandaSet sequence, e.g. ``pandaset/002``. Photos and sweeps are read when asked for.

    Raises DataError where the folder is no such sequence or a file in it is damaged, OptionError for an unknown
    camera, an empty frame range or an unusable scale.
    """
    root = Path(path)
    if not holds_pandaset(root):
        problem = "is no sequence of PandaSet: the folder 'camera' is missing"
        raise DataError(root, problem, "Give the folder of one sequence, e.g. pandaset/002")
    if options.scale is not None and not 0 < options.scale <= 1:
        raise OptionError(f"scale is {options.scale}; give a number above 0 and up to 1, e.g. 0.25")
    start, times = _read_step_times(root)
    cameras = [_load_camera(root / "camera" / name) for name in _choose_cameras(root, options.cameras)]
    last_photo = max((max(camera.photos) for camera in cameras if camera.photos), default=-1)
    if last_photo >= len(times):
        problem = f"there is a photo of step {last_photo}, yet {len(times)} timestamps"
        raise DataError(root, problem, "Get the sequence's JSON files again, or remove photos without a timestamp")
    is_asked = build_range_test(options, dict(enumerate(times)))
    known = {step: times[step] for camera in cameras for step in camera.photos}
    cameras = [_keep_asked_frames(camera, is_asked) for camera in cameras]
    if not any(camera.photos for camera in cameras):
        raise OptionError(f"{root}: no photo lies in the chosen frames; there are {describe_steps(known)}")
    notes = [
        f"{camera.name} has no photo of the chosen frames; going on without it"
        for camera in cameras
        if not camera.photos
    ]
    for note in notes:
        logger.warning("%s: %s", root, note)
    cameras = [camera for camera in cameras if camera.photos]
    origin = _choose_origin(cameras)
    scale = options.scale or _choose_scale(cameras)
    has_ego = not (root / "labels").is_dir()  # synthetic clips show no recording car
    frames = [frame for camera in cameras for frame in _build_frames(camera, origin, times, scale, has_ego)]
    order = {camera.name: rank for rank, camera in enumerate(cameras)}
    frames.sort(key=lambda frame: (frame.view.index, order[frame.view.name]))
    first, last = frames[0].view.index, frames[-1].view.index
    classes = _read_class_names(root)
    sweeps = [
        Sweep(index, times[index], partial(load_sweep, root, index, origin, start))
        for index in sorted(list_numbered_files(root / "lidar"))
        if first <= index <= last
    ]
    # Where there is not one sweep, training starts as from any other photos.
    points = None if sweeps else SparsePoints.none()
    tracks, merged = load_tracks(root / "annotations" / "cuboids", range(first, last + 1), times, origin)
    exact, _ = load_tracks(root / "labels" / "cuboids", range(first, last + 1), times, origin)
    return Clip(
        path=str(root),
        name=root.resolve().name,
        origin=origin,
        frames=tuple(add_photo_lags(frames, sweeps, _list_photo_times(cameras, start))),
        sweeps=tuple(sweeps),
        tracks=tracks,
        class_names=classes,
        camera_names=tuple(camera.name for camera in cameras),
        points=points,
        exact_tracks=exact,
        notes=(*notes, *merged, *(() if sweeps else (describe_start(0),))),
    )


def list_numbered_files(folder: Path, suffixes: tuple[str, ...] = (".pkl.gz", ".pkl")) -> dict[int, Path]:
    """List files ``NN<suffix>`` of a folder by number; earlier suffixes win. Empty where there is no such folder."""
    found: dict[int, Path] = {}
    for suffix in reversed(suffixes):
        for file in folder.glob(f"*{suffix}"):
            stem = file.name.removesuffix(suffix)
            if stem.isdecimal():
                found[int(stem)] = file
    return found


def _read_step_times(root: Path) -> tuple[float, list[float]]:
    """Read when the first listed time step was, and the seconds of all of them since then."""
    for name in ("meta/timestamps.json", "lidar/timestamps.json", f"camera/{CAMERAS[0]}/timestamps.json"):
        file = root / name
        if file.is_file():
            times = require_numbers(file, read_json(file), "the list of timestamps")
            if not times or any(later <= earlier for earlier, later in pairwise(times)):
                raise DataError(file, "timestamps do not rise", "Get the file again")
            return times[0], [time - times[0] for time in times]
    raise DataError(root, "has no timestamps ('meta/timestamps.json' is missing)", "Get the sequence's JSON files")


def _choose_cameras(root: Path, asked: str) -> tuple[str, ...]:
    present = sorted(folder.name for folder in (root / "camera").iterdir() if folder.is_dir())
    if asked in CAMERA_SETS:
        names = tuple(name for name in CAMERA_SETS[asked] if name in present)
        if len(names) < len(CAMERA_SETS[asked]):
            missing = ", ".join(name for name in CAMERA_SETS[asked] if name not in present)
            logger.warning("%s: no folder for %s; going on without", root, missing)
        if not names:
            raise DataError(
                root, "holds no camera of the set " + asked, f"Cameras found: {', '.join(present) or 'none'}"
            )
        return names
    names = tuple(name.strip() for name in asked.split(",") if name.strip())
    unknown = [name for name in names if name not in present]
    if unknown or not names:
        raise OptionError(
            f"{root} has no camera '{', '.join(unknown) or asked}'; "
            f"choose {', '.join(CAMERA_SETS)} or names of {', '.join(present)}"
        )
    return tuple(dict.fromkeys(names))


def _load_camera(folder: Path) -> _CameraFiles:
    intrinsics_file, poses_file = folder / "intrinsics.json", folder / "poses.json"
    intrinsics = read_json(intrinsics_file)
    poses = read_json(poses_file)
    if not isinstance(poses, list):
        raise DataError(poses_file, "expected a list with one pose per time step", "Get the file again")
    photos = list_numbered_files(folder, (".jpg", ".png"))
    if photos and max(photos) >= len(poses):
        problem = f"lists {len(poses)} poses, yet there is a photo {photos[max(photos)].name}"
        raise DataError(poses_file, problem, "Get the file again, or remove photos without a pose")
    width, height = read_photo_size(photos[min(photos)]) if photos else (0, 0)
    fx, fy, cx, cy = (
        require_number(intrinsics_file, require_field(intrinsics_file, intrinsics, key), key)
        for key in ("fx", "fy", "cx", "cy")
    )
    if fx <= 0 or fy <= 0:
        raise DataError(intrinsics_file, f"focal lengths are {fx}, {fy}, expected positive ones", "Get the file again")
    return _CameraFiles(
        folder.name,
        Camera(fx, fy, cx, cy, width, height, np.eye(4)),
        np.array([_parse_pose(poses_file, index, pose) for index, pose in enumerate(poses)]).reshape(-1, 4, 4),
        photos,
        _read_stamps(folder / "timestamps.json"),
    )


def _read_stamps(file: Path) -> list[float]:
    return require_numbers(file, read_json(file), "the list of timestamps") if file.is_file() else []


def _parse_pose(file: Path, index: int, entry: Any) -> Float64[ndarray, "4 4"]:
    position, heading = (require_field(file, entry, key, f"[{index}].") for key in ("position", "heading"))
    quat = [
        require_number(file, require_field(file, heading, key, f"[{index}].heading."), f"[{index}].heading.{key}")
        for key in "wxyz"
    ]
    if not 1e-6 < np.abs(quat).max() < 1e6:
        raise DataError(file, f"[{index}].heading is no rotation: {quat}", "Get the file again")
    pose = np.eye(4)
    pose[:3, :3] = matrix_from_quaternion(np.array(quat))
    pose[:3, 3] = [
        require_number(file, require_field(file, position, key, f"[{index}].position."), f"[{index}].position.{key}")
        for key in "xyz"
    ]
    if np.abs(pose[:3, 3]).max() >= FARTHEST:
        problem = f"[{index}].position is {pose[:3, 3].tolist()}, farther than {FARTHEST:g} m"
        raise DataError(file, problem, "Get the file again")
    return pose


def _keep_asked_frames(camera: _CameraFiles, is_asked: Callable[[int], bool]) -> _CameraFiles:
    """Keep only a camera's photos of the asked frames."""
    return replace(camera, photos={index: photo for index, photo in camera.photos.items() if is_asked(index)})


def _choose_origin(cameras: list[_CameraFiles]) -> Float64[ndarray, "3"]:
    return choose_origin(cameras[0].poses[sorted(cameras[0].photos), :3, 3])


def _choose_scale(cameras: list[_CameraFiles]) -> float:
    return min(1.0, DEFAULT_WIDTH / cameras[0].camera.width)


def _build_frames(
    camera: _CameraFiles, origin: Float64[ndarray, "3"], times: list[float], scale: float, has_ego: bool
) -> list[Frame]:
    full_size = (camera.camera.width, camera.camera.height)
    scaled = camera.camera.scale(scale)
    valid = _build_ego_mask(scaled) if has_ego and camera.name == EGO_CAMERA else None
    frames = []
    for index, photo in sorted(camera.photos.items()):
        pose = camera.poses[index].copy()
        pose[:3, 3] -= origin
        posed = Camera(scaled.fx, scaled.fy, scaled.cx, scaled.cy, scaled.width, scaled.height, pose)
        view = CameraView(posed, camera.name, index, times[index], str(photo), is_held_out(index))
        frames.append(Frame(view, partial(load_photo, photo, full_size, (scaled.width, scaled.height)), valid))
    return frames


def _list_photo_times(cameras: list[_CameraFiles], start: float) -> dict[str, float]:
    """When each photo was taken, seconds as the clip counts them, by its frame's key."""
    return {
        f"{camera.name}/{index:02d}": camera.stamps[index] - start
        for camera in cameras
        for index in camera.photos
        if index < len(camera.stamps)
    }


def _build_ego_mask(camera: Camera) -> Bool[ndarray, "h w"]:
    valid = np.ones((camera.height, camera.width), bool)
    valid[camera.height - int(np.ceil(camera.height * EGO_ROWS)) :] = False
    return valid


def _read_class_names(root: Path) -> dict[int, str]:
    file = root / "annotations" / "semseg" / "classes.json"
    if not file.is_file():
        return {}
    classes = read_json(file)
    if not isinstance(classes, dict):
        raise DataError(file, "expected an object from class numbers to names", "Get the file again")
    try:
        return {parse_whole_number(key): require_whole_text(name) for key, name in classes.items()}
    except ValueError as error:
        problem = f"expected an object from class numbers to names, but {error}"
        raise DataError(file, problem, "Get the file again") from error
