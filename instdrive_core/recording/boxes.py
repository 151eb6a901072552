"""Where the things are at a moment: boxes in the world with velocities."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.maths.rotations import quaternion_from_matrix
from instdrive_core.recording.things import Thing
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.track import Track

_APART = 0.05
"""Seconds before and after the moment between which a velocity is measured."""


@dataclass(frozen=True)
class PlacedBox:
    """A thing's box at a moment, relative to the scene's origin."""

    thing: Thing
    world_from_box: Float64[ndarray, "4 4"]
    """x right, y forward, z up."""
    velocity: Float64[ndarray, "3"]
    """Metres per second, in the world."""


def place_boxes(scene: Scene, things: Sequence[Thing], time: float) -> tuple[PlacedBox, ...]:
    """Place the boxes of all things that are there at `time` (seconds)."""
    poses, present = scene.find_node_poses(time)
    placed = []
    for thing in things:
        if not present[thing.node]:
            continue
        velocity = np.zeros(3)
        if thing.node:
            velocity = _measure_velocity(scene.actors[thing.node - 1], thing.node_from_box[:3, 3], time)
        placed.append(PlacedBox(thing, poses[thing.node] @ thing.node_from_box, velocity))
    return tuple(placed)


def describe_box(box: PlacedBox) -> dict[str, Any]:
    """Describe a box as JSON values; the manifest says what they mean."""
    thing = box.thing
    width, length, height = thing.dimensions.tolist()
    return {
        "id": thing.instance.id,
        "name": thing.instance.name,
        "class": thing.instance.class_name,
        "center": _round(box.world_from_box[:3, 3]),
        "size": {"width": round(width, 6), "length": round(length, 6), "height": round(height, 6)},
        "rotation": _round(quaternion_from_matrix(box.world_from_box[:3, :3])),
        "yaw": round(float(np.arctan2(box.world_from_box[1, 1], box.world_from_box[0, 1])), 6),
        "velocity": _round(box.velocity),
        "moving": thing.node > 0,
        "heading_known": thing.heads,
        "from": thing.source,
    }


def _measure_velocity(track: Track, point: Float64[ndarray, "3"], time: float) -> Float64[ndarray, "3"]:
    """Velocity of a point of the track's frame; at the ends of the track that beside the end."""
    if len(track.times) < 2:
        return np.zeros(3)
    early = float(np.clip(time - _APART, track.times[0], track.times[-1] - 2 * _APART))
    early = max(early, float(track.times[0]))
    late = min(early + 2 * _APART, float(track.times[-1]))
    ends = track.interpolate_poses(np.array([early, late]))
    moved = (ends[1] - ends[0])[:3, :3] @ point + (ends[1] - ends[0])[:3, 3]
    return moved / max(late - early, 1e-9)


def _round(values: ndarray) -> list[float]:
    return np.round(values, 6).tolist()
