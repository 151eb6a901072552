"""Another rig on the recorded way: the drive's cameras kept, moved or given other lenses, and new ones."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.files.json_fields import read_json, require_field, require_number, require_numbers
from instdrive_core.maths.rotations import matrix_from_quaternion
from instdrive_core.scene.camera import Camera, CameraView
from instdrive_core.sweeps.rig import build_rig

LARGEST_SIDE = 16384
MOST_CAMERAS = 64
FARTHEST = 20.0
"""Metres from amid the cameras, at most."""
_REMEDY = "docs/recording.md describes the file"
_FIELDS = ("name", "like", "place_m", "move_m", "yaw_deg", "pitch_deg", "roll_deg", "width", "height", "field_deg")
_RIG_FROM_CAMERA = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
"""From right, down, forward to forward, left, up."""
_UNUSABLE = '/\\:\0"<>|?*'


@dataclass(frozen=True)
class MountedLens:
    """A pinhole's picture: square pixels, the axis in the middle."""

    width: int
    height: int
    field_deg: float
    """From the left edge to the right, degrees."""

    def build_camera(self, pose: Float64[ndarray, "4 4"]) -> Camera:
        """Build the camera at a pose."""
        focal = self.width / 2 / math.tan(math.radians(self.field_deg) / 2)
        return Camera(focal, focal, self.width / 2, self.height / 2, self.width, self.height, pose)


@dataclass(frozen=True)
class RigEntry:
    """One camera of the rig."""

    name: str
    like: str | None
    """The drive's camera from which everything comes that is not said; None: it looks ahead."""
    place: tuple[float, float, float] | None
    """x forward, y left, z up from amid the drive's cameras, metres; None: where `like` is."""
    move: tuple[float, float, float]
    """Metres by which it is moved along the same axes."""
    turn: tuple[float, float, float]
    """Yaw to the left, pitch up and roll to the right, degrees: of `like`, or of what looks ahead."""
    lens: MountedLens | None
    """None: that of `like`."""


def read_camera_rig(file: Path) -> tuple[RigEntry, ...]:
    """Read a JSON file with a list ``cameras``. Raises DataError naming the field that is wrong."""
    listed = require_field(file, read_json(file), "cameras")
    if not isinstance(listed, list) or not 1 <= len(listed) <= MOST_CAMERAS:
        raise DataError(file, f"'cameras' is not a list of 1 to {MOST_CAMERAS} cameras", _REMEDY)
    entries = tuple(_read_entry(file, number, entry) for number, entry in enumerate(listed))
    names = [entry.name for entry in entries]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise DataError(file, f"two cameras are called {twice[0]!r}", "Give each a name of its own")
    return entries


def mount_cameras(file: Path, views: Sequence[CameraView], entries: Sequence[RigEntry]) -> tuple[CameraView, ...]:
    """Mount the rig's cameras on the way of the drive's own: a view of each at every moment.

    A camera of the drive that nothing is changed of stays as it is, with its photos. Others see at the moments of the
    one that they are like; without one at those amid the drive's cameras.

    Args:
        file: named in errors.
        views: of all cameras at all moments, on the way that is recorded.
        entries: what `read_camera_rig` read.

    Raises DataError where a camera is like one that there is not.
    """
    names = list(dict.fromkeys(view.name for view in views))
    rig, mounted = build_rig(views), []
    amid = _find_moments(views)
    for number, entry in enumerate(entries):
        if entry.like is not None and entry.like not in names:
            problem = f"'cameras[{number}].like' is {entry.like!r}; the drive has {', '.join(names)}"
            raise DataError(file, problem, "Name one of those, or leave it out")
        looks = amid if entry.like is None else [view for view in views if view.name == entry.like]
        mounted += [_mount(view, entry, rig) for view in looks]
    return tuple(mounted)


def _mount(view: CameraView, entry: RigEntry, rig: Any) -> CameraView:
    if entry == RigEntry(view.name, view.name, None, (0, 0, 0), (0, 0, 0), None):
        return view
    places, turns = rig.place(np.array([view.time]))
    world_from_rig = np.eye(4)
    world_from_rig[:3, :3], world_from_rig[:3, 3] = turns[0], places[0]
    pose = np.eye(4)
    pose[:3, :3] = _RIG_FROM_CAMERA
    if entry.like is not None:
        pose = np.linalg.inv(world_from_rig) @ view.camera.world_from_camera
    if entry.place is not None:
        pose[:3, 3] = entry.place
    pose[:3, 3] += entry.move
    pose[:3, :3] = pose[:3, :3] @ _turn(*entry.turn)
    placed = world_from_rig @ pose
    camera = replace(view.camera, world_from_camera=placed) if entry.lens is None else entry.lens.build_camera(placed)
    return CameraView(camera, entry.name, view.index, view.time)


def _turn(yaw: float, pitch: float, roll: float) -> Float64[ndarray, "3 3"]:
    """Turns about the camera's own axes (right, down, forward), yaw first."""
    turned = np.eye(3)
    for angle, axis in ((-yaw, 1), (pitch, 0), (roll, 2)):
        quat = np.zeros(4)
        quat[0], quat[1 + axis] = math.cos(math.radians(angle) / 2), math.sin(math.radians(angle) / 2)
        turned = turned @ matrix_from_quaternion(quat)
    return turned


def _find_moments(views: Sequence[CameraView]) -> list[CameraView]:
    """The first view of each time step, at the mean time of the step's views."""
    steps: dict[int, list[CameraView]] = {}
    for view in views:
        steps.setdefault(view.index, []).append(view)
    return [replace(found[0], time=float(np.mean([view.time for view in found]))) for _, found in sorted(steps.items())]


def _read_entry(file: Path, number: int, entry: Any) -> RigEntry:
    where = f"cameras[{number}]."
    name = require_field(file, entry, "name", where)
    if not isinstance(name, str) or not 0 < len(name) <= 100 or name in (".", "..") or set(name) & set(_UNUSABLE):
        raise DataError(file, f"the field '{where}name' is {name!r}, which cannot be a folder's name", _REMEDY)
    unknown = [field for field in entry if field not in _FIELDS]
    if unknown:
        raise DataError(file, f"the field '{where}{unknown[0]}' is not known", f"Fields are {', '.join(_FIELDS)}")
    like = entry.get("like")
    if like is not None and not isinstance(like, str):
        raise DataError(file, f"the field '{where}like' is {like!r}, expected a camera's name", _REMEDY)
    place = None if "place_m" not in entry else _read_place(file, entry["place_m"], f"{where}place_m")
    if like is None and place is None:
        raise DataError(file, f"camera {name!r} has neither 'like' nor 'place_m'", _REMEDY)
    move = _read_place(file, entry.get("move_m", [0, 0, 0]), f"{where}move_m")
    turn = [_read_angle(file, entry.get(field, 0), where + field) for field in ("yaw_deg", "pitch_deg", "roll_deg")]
    lens = _read_lens(file, entry, where)
    if lens is None and like is None:
        raise DataError(file, f"camera {name!r} has neither 'like' nor 'width', 'height' and 'field_deg'", _REMEDY)
    return RigEntry(name, like, place, move, (turn[0], turn[1], turn[2]), lens)


def _read_place(file: Path, value: Any, field: str) -> tuple[float, float, float]:
    place = require_numbers(file, value, field)
    if len(place) != 3 or max(map(abs, place)) > FARTHEST:
        raise DataError(file, f"the field '{field}' is {value!r}, expected three numbers up to {FARTHEST:g} m", _REMEDY)
    return place[0], place[1], place[2]


def _read_angle(file: Path, value: Any, field: str) -> float:
    angle = require_number(file, value, field)
    if abs(angle) > 360:
        raise DataError(file, f"the field '{field}' is {angle:g}, expected degrees from -360 to 360", _REMEDY)
    return angle


def _read_lens(file: Path, entry: Any, where: str) -> MountedLens | None:
    given = [field for field in ("width", "height", "field_deg") if field in entry]
    if not given:
        return None
    for field in ("width", "height"):
        value = require_field(file, entry, field, where)
        if isinstance(value, bool) or not isinstance(value, int) or not 8 <= value <= LARGEST_SIDE:
            problem = f"the field '{where}{field}' is {value!r}, expected a whole number from 8 to {LARGEST_SIDE}"
            raise DataError(file, problem, _REMEDY)
    angle = require_number(file, require_field(file, entry, "field_deg", where), f"{where}field_deg")
    if not 1 <= angle <= 150:
        raise DataError(file, f"the field '{where}field_deg' is {angle:g}, expected 1 to 150 degrees", _REMEDY)
    return MountedLens(entry["width"], entry["height"], angle)
