"""Clips from nothing but posed photos and maybe sparse points, as COLMAP's and nerfstudio's folders hold them."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from jaxtyping import Bool, Float64, UInt8
from numpy import ndarray

from instdrive_core.datasets.clip import Clip, ClipOptions, Frame, SparsePoints, choose_origin, is_held_out
from instdrive_core.datasets.distortion import AnyDistortion, find_covered_pixels, undistort
from instdrive_core.datasets.fisheye import WIDEST, Fisheye, choose_pinhole
from instdrive_core.datasets.frame_range import build_range_test, describe_steps
from instdrive_core.datasets.photos import load_photo
from instdrive_core.datasets.upright import find_upright_world
from instdrive_core.errors import DataError, OptionError, UntrustedDataError
from instdrive_core.files.image_limit import MAX_PIXELS
from instdrive_core.scene.camera import Camera, CameraView

logger = logging.getLogger(__name__)

DEFAULT_WIDTH = 480
"""Pixels to which photos are scaled where no scale is asked for."""
STEP_SECONDS = 0.1
"""Assumed between photos, as the files have no times."""
_LONGEST_NAME, _LONGEST_PATH = 255, 2000
"""Bytes of one file's name, characters of a path: file systems know no longer ones."""
_FARTHEST_POINT = 1e30
"""Metres in the upright world: float32 ends soon after."""
_CAMERA_COUNTS = {"1": 1, "3": 3, "6": None}


@dataclass(frozen=True)
class PosedPhoto:
    """One photo as a file lists it."""

    name: str
    """Path as listed; photos of one camera are ordered by it, and their folder is the camera's name."""
    file: Path
    """Its place on disk, whether or not it is there."""
    camera: Camera
    """At full size, in the file's world."""
    distortion: AnyDistortion


@dataclass(frozen=True)
class ListedPoints:
    """Points in the file's world."""

    points: Float64[ndarray, "n 3"]
    colors: UInt8[ndarray, "n 3"]

    @staticmethod
    def none() -> ListedPoints:
        """No points at all."""
        return ListedPoints(np.zeros((0, 3)), np.zeros((0, 3), np.uint8))


def resolve_inner_path(listing: Path, folder: Path, name: Any) -> Path:
    """Find the file of a folder that `listing` calls `name`. Raises UntrustedDataError where the name leads out of
    it."""
    if not isinstance(name, str) or not name:
        raise DataError(listing, f"{name!r} stands where a file's name should", "Export the data set again")
    is_writable = not any(sign < " " or "\ud800" <= sign <= "\udfff" for sign in name)
    if not is_writable or len(name) > _LONGEST_PATH or max(map(len, name.encode().split(b"/"))) > _LONGEST_NAME:
        problem = f"{name[:80]!a} with {len(name)} characters stands where a file's name should"
        raise DataError(listing, problem, "Export the data set again")
    parts = PurePosixPath(name)
    if parts.is_absolute() or ".." in parts.parts or any(sign in name for sign in "\\:\0") or not parts.parts:
        problem = f"the file name {name[:200]!r} leads out of {folder}"
        raise UntrustedDataError(listing, problem, "Do not use this data set unless you know who made it")
    return folder / parts


def build_photo_clip(
    root: Path,
    listing: Path,
    photos: list[PosedPhoto],
    points: ListedPoints,
    options: ClipOptions,
    notes: tuple[str, ...] = (),
) -> Clip:
    """Build a static clip without LiDAR. Photos not on disk are left out, but keep their place in the order.

    Args:
        root: the clip's folder.
        listing: the file that lists the photos, for messages.
        photos: all that are listed.
        points: what training starts from, maybe none.
        options: which part to load.
        notes: what a user should know besides what is found here.

    Raises DataError where no photo is there, OptionError for an unknown camera, an empty frame range or a bad scale.
    """
    check_field(options)
    if not photos:
        raise DataError(listing, "lists no photo", "Export the data set again")
    if options.scale is not None and not 0 < options.scale <= 1:
        raise OptionError(f"scale is {options.scale}; give a number above 0 and up to 1, e.g. 0.25")
    ordered = _order_photos(root, photos, options.cameras)
    present = [entry for entry in ordered if entry[1].file.is_file()]
    missing = _describe_missing(listing, ordered, present)
    times = {step: STEP_SECONDS * step for step, _ in ordered}
    is_asked = build_range_test(options, times)
    chosen = [entry for entry in present if is_asked(entry[0])]
    if not chosen:
        raise OptionError(f"{root}: no photo lies in the chosen frames; there are {describe_steps(times)}")
    world = find_upright_world(np.stack([photo.camera.world_from_camera for photo in photos]), points.points)
    poses = world.transform_poses(np.stack([photo.camera.world_from_camera for _, photo in chosen]))
    origin = choose_origin(poses[:, :3, 3])
    poses[:, :3, 3] -= origin
    chosen = [
        (
            step,
            straighten_photo(
                replace(photo, camera=replace(photo.camera, world_from_camera=pose)), options.fisheye_field
            ),
        )
        for (step, photo), pose in zip(chosen, poses, strict=True)
    ]
    scale = options.scale or min(1.0, DEFAULT_WIDTH / chosen[0][1].camera.width)
    coverage = _build_coverage_cache()
    placed = world.transform_points(points.points) - origin
    if not (np.abs(placed) < _FARTHEST_POINT).all():
        far = f"points and cameras tell no believable scale: all would be made {world.scale:.3g} times as large"
        raise DataError(listing, far, "Check the points and the cameras' positions, then export both again")
    return Clip(
        path=str(root),
        name=root.resolve().name,
        origin=origin,
        frames=tuple(_build_frame(step, photo, scale, coverage) for step, photo in chosen),
        sweeps=(),
        tracks=(),
        class_names={},
        camera_names=tuple(dict.fromkeys(get_camera_name(photo) for _, photo in chosen)),
        points=SparsePoints(placed.astype(np.float32), points.colors),
        notes=(*missing, *notes, *world.notes, describe_start(len(points.points))),
        world_from_file=np.c_[world.scale * world.rotation, np.zeros(3)],
    )


def get_camera_name(photo: PosedPhoto) -> str:
    """Name a photo's camera: its folder below ``images``, or ``camera`` where there is none."""
    folders = [part for part in PurePosixPath(photo.name).parts[:-1] if part != "images"]
    return "_".join(folders) or "camera"


def build_camera(listing: Path, where: str, intrinsics: tuple[float, ...], size: tuple[int, int]) -> Camera:
    """Build a camera without pose from fx, fy, cx, cy. Raises DataError where no photo can have been taken with it."""
    fx, fy, cx, cy = intrinsics
    width, height = size
    if not (0 < width < 1 << 16 and 0 < height < 1 << 16 and width * height <= MAX_PIXELS):
        raise DataError(listing, f"{where}: the size is {width}×{height} pixels", "Export the data set again")
    if not all(map(math.isfinite, intrinsics)) or fx <= 0 or fy <= 0:
        problem = f"{where}: fx, fy, cx, cy are {fx}, {fy}, {cx}, {cy}; expected numbers, the first two positive"
        raise DataError(listing, problem, "Export the data set again")
    return Camera(fx, fy, cx, cy, width, height, np.eye(4))


def check_points(listing: Path, points: Float64[ndarray, "n 3"]) -> None:
    """Raise DataError where a coordinate is no number that positions can have."""
    bad = np.flatnonzero(~(np.abs(points) < 1e9).all(axis=1))
    if len(bad):
        problem = f"point {bad[0]} lies at {points[bad[0]].tolist()} ({len(bad)} such points)"
        raise DataError(listing, problem, "Export the points again")


def _order_photos(root: Path, photos: list[PosedPhoto], asked: str) -> list[tuple[int, PosedPhoto]]:
    """Order photos of the asked cameras by time step, which is their place in their own camera's order."""
    by_camera: dict[str, list[PosedPhoto]] = {}
    for photo in sorted(photos, key=lambda photo: photo.name):
        by_camera.setdefault(get_camera_name(photo), []).append(photo)
    names = choose_cameras(root, tuple(by_camera), asked)
    steps = [(step, rank, photo) for rank, name in enumerate(names) for step, photo in enumerate(by_camera[name])]
    return [(step, photo) for step, _, photo in sorted(steps, key=lambda entry: entry[:2])]


def choose_cameras(root: Path, present: tuple[str, ...], asked: str) -> tuple[str, ...]:
    """Choose cameras by their number, the first of those `present` (``1``, ``3`` or ``6`` for all), or by names.

    Raises OptionError for a name that is not there.
    """
    if asked in _CAMERA_COUNTS:
        return present[: _CAMERA_COUNTS[asked]]
    names = tuple(dict.fromkeys(name.strip() for name in asked.split(",") if name.strip()))
    unknown = [name for name in names if name not in present]
    if unknown or not names:
        raise OptionError(
            f"{root} has no camera '{', '.join(unknown) or asked}'; "
            f"choose {', '.join(_CAMERA_COUNTS)} or names of {', '.join(present)}"
        )
    return names


def _describe_missing(
    listing: Path, listed: list[tuple[int, PosedPhoto]], present: list[tuple[int, PosedPhoto]]
) -> tuple[str, ...]:
    """A note on photos that are not there, also logged. Raises DataError where none is."""
    missing = [photo.file for _, photo in listed if not photo.file.is_file()]
    if not present:
        problem = f"none of the {len(listed)} photos that it lists is there, e.g. {missing[0]}"
        raise DataError(listing, problem, "Put the photos into the folder under the names that the file lists")
    if not missing:
        return ()
    note = f"{len(missing)} of {len(listed)} photos are missing, e.g. {missing[0]}"
    logger.warning("%s: %s", listing, note)
    return (note,)


def check_field(options: ClipOptions) -> None:
    """Raise OptionError where no pinhole has the field that is asked for."""
    if not 10 <= options.fisheye_field <= WIDEST:
        raise OptionError(f"--fisheye-field is {options.fisheye_field}; give degrees from 10 to {WIDEST:g}")


def straighten_photo(photo: PosedPhoto, field: float = ClipOptions.fisheye_field) -> PosedPhoto:
    """Give a fisheye's photo the pinhole of `field` degrees that takes its place; others stay as they are."""
    if not isinstance(photo.distortion, Fisheye):
        return photo
    camera, distortion = choose_pinhole(photo.camera, photo.distortion, field)
    return replace(photo, camera=camera, distortion=distortion)


Coverage = Callable[[Camera, AnyDistortion], Bool[ndarray, "h w"] | None]


def _build_coverage_cache() -> Coverage:
    """Build a function for the pixels that undistorted photos fill; photos of one camera share one mask."""

    @lru_cache(maxsize=64)
    def find_once(
        fx: float, fy: float, cx: float, cy: float, width: int, height: int, distortion: AnyDistortion
    ) -> ndarray:
        return find_covered_pixels(Camera(fx, fy, cx, cy, width, height, np.eye(4)), distortion)

    def find_coverage(camera: Camera, distortion: AnyDistortion) -> ndarray | None:
        if distortion.is_pinhole:
            return None
        return find_once(camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height, distortion)

    return find_coverage


def _build_frame(step: int, photo: PosedPhoto, scale: float, coverage: Coverage) -> Frame:
    full = photo.camera
    camera = full.scale(scale)
    view = CameraView(camera, get_camera_name(photo), step, STEP_SECONDS * step, str(photo.file), is_held_out(step))
    load = partial(_load_undistorted, photo.file, (full.width, full.height), camera, photo.distortion)
    return Frame(view, load, coverage(camera, photo.distortion))


def _load_undistorted(
    file: Path, full_size: tuple[int, int], camera: Camera, distortion: AnyDistortion
) -> UInt8[ndarray, "h w 3"]:
    image = load_photo(file, full_size, (camera.width, camera.height))
    return image if distortion.is_pinhole else undistort(image, camera, distortion)


def describe_start(count: int) -> str:
    """Say what training of a clip without LiDAR starts from."""
    if count:
        return f"no LiDAR: starting from {count:,} sparse points and from what photos agree on"
    return "no LiDAR and no points: starting from what photos agree on"
