"""Edits that give a vehicle another way, from keys, templates, or where it is at a time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

from instdrive_core.edits.document.edit import Edit
from instdrive_core.edits.kinds.compound import CompoundEdit
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.kinds.driving.set_path import SetPath
from instdrive_core.edits.kinds.driving.start_driving import StartDriving
from instdrive_core.instances.table import Instance
from instdrive_core.scene.track import Track
from instdrive_core.scene.vehicle_path import (
    PathKey,
    change_lane,
    change_speed,
    describe_way,
    start_at,
    stop_at,
    trace_way,
    turn_off,
    wait_at,
)
from instdrive_core.wording import phrase

Template = Literal["lane", "stop", "speed", "turn", "wait", "start"]


def drive_instance(entry: Instance, keys: Sequence[PathKey]) -> Edit:
    """Build the edit that lets an instance drive a way; what stands still gives its place up."""
    way = describe_way(keys)
    if entry.node:
        return SetPath(entry.id, way)
    return CompoundEdit(
        (StartDriving(entry.id, way), DeleteInstances((entry.id,))), phrase("Let {name} drive", name=entry.name)
    )


def change_way(track: Track, template: Template, amount: float, start: float) -> tuple[PathKey, ...]:
    """Change a mover's own way from `start` seconds on: by metres (`lane`), a factor (`speed`), degrees (`turn`),
    seconds of standing (`wait`); `stop` and `start` need no amount."""
    keys = trace_way(track)
    match template:
        case "lane":
            return change_lane(keys, amount, start)
        case "stop":
            return stop_at(keys, start)
        case "speed":
            return change_speed(keys, amount, start)
        case "turn":
            return turn_off(keys, math.radians(amount), start)
        case "wait":
            return wait_at(keys, amount, start)
        case "start":
            return start_at(keys, start)


def park_at(track: Track, time: float) -> tuple[PathKey, ...]:
    """Park a mover where it is at a time (seconds)."""
    pose = track.interpolate_pose(time)
    return (PathKey(time, float(pose[0, 3]), float(pose[1, 3]), math.atan2(pose[1, 1], pose[0, 1])),)
