"""Another way for the recording car: beside its own, in another lane, slower, stopping, or drawn."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float64
from numpy import ndarray
from scipy.spatial import KDTree

from instdrive_core.errors import DataError, OptionError
from instdrive_core.formats.objects.scenario_ways import MARK, is_scenario, read_scenario_way
from instdrive_core.maths.rotations import matrix_from_quaternion
from instdrive_core.scene.camera import CameraView
from instdrive_core.scene.track import Track
from instdrive_core.scene.vehicle_path import sample_path
from instdrive_core.scene.ways.drawn_way import DrawnWay, read_drawn_way, time_way

Kind = Literal["shift", "lane", "speed", "stop", "path"]
FARTHEST = 50.0
"""Metres to the side, at most: nothing was seen from farther away."""
LANE_SECONDS = 3.0
"""Time that a change of lane takes where none is said."""
BRAKE_SECONDS = 2.0
"""Time from the first braking until the car stands."""
_LEAST_WAY = 1.0
"""Metres of the drive from which the way says where forward is."""
_EGO_NAMES = ("Ego", "ego", "EGO", "hero", "Hero")
"""Entities that are taken for the recording car where several have ways."""
_FORMS = "shift=METRES, lane=METRES@SECONDS or lane=METRES@FROM-TO, speed=FACTOR, stop=SECONDS, path=FILE or FILE.xosc"


@dataclass(frozen=True)
class EgoChange:
    """One change of the way; several are done together."""

    kind: Kind
    value: float
    """Metres to the left, the factor of the speed, or when the car begins to brake, seconds since the first view."""
    start: float = 0.0
    """When a change of lane begins, seconds since the first view."""
    seconds: float = LANE_SECONDS
    """How long a change of lane takes."""
    drawn: DrawnWay | None = None
    """The way of a `path`, which is driven instead of the recorded one; other changes are then changes of it."""


def parse_ego_change(text: str) -> EgoChange:
    """Parse ``shift=1.5``, ``lane=-3.5@2``, ``lane=3.5@2-6``, ``speed=0.5``, ``stop=3``, ``path=way.json``,
    ``path=drive.xosc#Ego`` or ``drive.xosc``.

    Raises OptionError, and DataError for a file that holds no way.
    """
    name, _, file = text.strip().partition("=")
    if name == "path" and file:
        return EgoChange("path", 0.0, drawn=read_ego_way(file))
    if is_scenario(text.strip()):
        return EgoChange("path", 0.0, drawn=read_ego_way(text.strip()))
    number = r"([+-]?\d+(?:\.\d+)?)"
    found = re.fullmatch(rf"(shift|speed|stop)={number}|lane={number}@{number}(?:-{number})?", text.strip())
    if found is None:
        raise OptionError(f"{text!r} is no change of the way; write {_FORMS}")
    if found[1] is not None:
        kind: Kind = "shift" if found[1] == "shift" else "speed" if found[1] == "speed" else "stop"
        change = EgoChange(kind, float(found[2]))
    else:
        start = float(found[4])
        end = start + LANE_SECONDS if found[5] is None else float(found[5])
        change = EgoChange("lane", float(found[3]), start, end - start)
    _check(change, text)
    return change


def read_ego_way(name: str) -> DrawnWay:
    """Read the way of the recording car: a file of keys, or an OpenSCENARIO file, with `#ENTITY` or without.

    An entity's reference point is driven by the camera with the most views. Raises DataError, and OptionError where it
    is not clear whose way is meant.
    """
    if not is_scenario(name):
        return read_drawn_way(Path(name))
    keys = read_scenario_way(name, np.zeros(3), _EGO_NAMES, follows_middle=False)
    if len(keys) < 2:
        raise DataError(Path(name.split(MARK)[0]), "the way has one vertex only", "Give it two at least")
    headings = tuple(key.heading for key in keys if key.heading is not None)
    return DrawnWay(
        tuple((key.x, key.y) for key in keys),
        times=tuple(key.time for key in keys),
        headings=headings if len(headings) == len(keys) else (),
        in_world=True,
    )


def reroute_views(
    views: Sequence[CameraView], changes: Sequence[EgoChange], origin: Float64[ndarray, "3"]
) -> tuple[CameraView, ...]:
    """Move the cameras of all views onto the changed way: the rig stays as it is, moments stay the same.

    Args:
        views: all views of the drive, so that the way is known between them and beyond those that are recorded.
        changes: what is changed. Raises OptionError where a drawn way leads too far from the recorded one.
        origin: of the scene, in the data set's world.
    """
    if not changes or not views:
        return tuple(views)
    recorded = find_ego_way(views)
    drawn = next((change.drawn for change in changes if change.drawn is not None), None)
    way = recorded if drawn is None else drive_drawn_way(recorded, drawn.place_in_scene(origin))
    start = float(recorded.times[0])
    moved = []
    for view in views:
        own = recorded.interpolate_pose(view.time)
        pose = _place_car(way, changes, view.time - start) @ np.linalg.inv(own) @ view.camera.world_from_camera
        moved.append(replace(view, camera=replace(view.camera, world_from_camera=pose)))
    return tuple(moved)


def find_ego_way(views: Sequence[CameraView]) -> Track:
    """Find the way of the recording car from the camera with the most views: x right, y forward, z up.

    Forward is where the car gets to, or where the camera looks in a drive of less than a metre.
    """
    names = [view.name for view in views]
    name = max(dict.fromkeys(names), key=names.count)
    poses = {view.time: view.camera.world_from_camera for view in views if view.name == name}
    times = np.array(sorted(poses))
    cameras = np.stack([poses[time] for time in times.tolist()])
    places = cameras[:, :2, 3]
    far = int(np.argmax(np.linalg.norm(places - places[0], axis=1) >= _LEAST_WAY))
    ahead = places[far] - places[0] if far else cameras[0, :2, 2]
    forward = ahead / max(float(np.linalg.norm(ahead)), 1e-9)
    car = np.eye(4)
    car[:2, 0], car[:2, 1], car[:3, 3] = (forward[1], -forward[0]), forward, cameras[0, :3, 3]
    camera_from_car = np.linalg.inv(cameras[0]) @ car
    return Track("ego", "ego", np.ones(3), times, cameras @ camera_from_car, True)


def drive_drawn_way(recorded: Track, drawn: DrawnWay) -> Track:
    """Drive a drawn way: heading along it, as high and as inclined as the recorded car was nearest to each place.

    Both are in the scene.
    Raises OptionError where a place is farther than `FARTHEST` metres from the recorded way.
    """
    keys = time_way(drawn, recorded)
    times = np.unique(np.r_[recorded.times, [key.time for key in keys if recorded.covers(key.time)]])
    tree = KDTree(recorded.world_from_box[:, :2, 3])
    apart = tree.query(np.array(drawn.places), workers=1)[0]
    if float(apart.max()) > FARTHEST:
        x, y = drawn.places[int(np.argmax(apart))]
        raise OptionError(
            f"the drawn way leads to x = {x:.1f}, y = {y:.1f}, {apart.max():.0f} m from the recorded one; at most "
            f"{FARTHEST:g} m are possible"
        )
    first = recorded.world_from_box[0]
    found = sample_path(keys, times, math.atan2(first[1, 1], first[0, 1]))
    nearest = tree.query(found.places, workers=1)[1]
    poses = recorded.world_from_box[nearest].copy()
    turns = found.headings - np.arctan2(poses[:, 1, 1], poses[:, 0, 1])
    cosine, sine, zero, one = np.cos(turns), np.sin(turns), np.zeros_like(turns), np.ones_like(turns)
    about_z = np.stack([cosine, -sine, zero, sine, cosine, zero, zero, zero, one], axis=1).reshape(-1, 3, 3)
    poses[:, :3, :3] = about_z @ poses[:, :3, :3]
    poses[:, :2, 3] = found.places
    return Track("ego", "ego", np.ones(3), times, poses, True)


def _place_car(way: Track, changes: Sequence[EgoChange], seconds: float) -> Float64[ndarray, "4 4"]:
    """world_from_car on the changed way."""
    start = float(way.times[0])
    moment = _change_time(changes, seconds)
    pose = way.interpolate_pose(start + moment)
    left, ahead = _change_lane(changes, seconds), 0.05
    sideways = (_change_lane(changes, seconds + ahead) - _change_lane(changes, seconds - ahead)) / (2 * ahead)
    later = way.interpolate_pose(start + _change_time(changes, seconds + ahead))[:3, 3]
    before = way.interpolate_pose(start + _change_time(changes, seconds - ahead))[:3, 3]
    speed = float(np.linalg.norm(later - before)) / (2 * ahead)
    yaw = math.atan2(sideways, speed) if speed > 0.5 else 0.0
    turn = np.eye(4)
    turn[:3, :3] = matrix_from_quaternion(np.array([math.cos(yaw / 2), 0, 0, math.sin(yaw / 2)]))
    turn[0, 3] = -left
    return pose @ turn


def _change_time(changes: Sequence[EgoChange], seconds: float) -> float:
    """Seconds of its own drive at which the car was where it is now."""
    for change in changes:
        if change.kind == "speed":
            seconds *= change.value
        elif change.kind == "stop":
            braking = min(max(seconds - change.value, 0.0), BRAKE_SECONDS)
            seconds = min(seconds, change.value) + braking - braking**2 / (2 * BRAKE_SECONDS)
    return seconds


def _change_lane(changes: Sequence[EgoChange], seconds: float) -> float:
    """Metres to the left of its own way."""
    left = 0.0
    for change in changes:
        if change.kind == "shift":
            left += change.value
        elif change.kind == "lane":
            share = min(max((seconds - change.start) / change.seconds, 0.0), 1.0)
            left += change.value * share**3 * (10 - 15 * share + 6 * share**2)  # no jump in speed or acceleration
    return left


def _check(change: EgoChange, text: str) -> None:
    if change.kind in ("shift", "lane") and abs(change.value) > FARTHEST:
        raise OptionError(f"{text!r} goes {abs(change.value):g} m to the side; at most {FARTHEST:g} m are possible")
    if change.kind == "lane" and not (change.seconds >= 0.5 and change.start >= 0):
        raise OptionError(f"{text!r}: a change of lane takes at least 0.5 s and begins at 0 s or later")
    if change.kind == "speed" and not 0 <= change.value <= 1:
        raise OptionError(f"{text!r}: the factor of the speed is from 0 to 1; what lies beyond the drive is not known")
    if change.kind == "stop" and change.value < 0:
        raise OptionError(f"{text!r}: the car begins to brake at 0 s or later")
