"""Objects as JSON: one entry per instance, and the tracks that moving ones follow."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray

from instdrive_core.files.atomic import write_bytes
from instdrive_core.formats.objects.scene_objects import SceneObject
from instdrive_core.instances.oriented_box import OrientedBox
from instdrive_core.maths.rotations import quaternion_from_matrix
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.track import Track

FORMAT_NAME, FORMAT_VERSION = "instdrive objects", 1
CONVENTIONS = {
    "length": "metres, or the clip's own unit where its scale is unknown",
    "axes": "right-handed, z up; add 'origin' for the data set's world",
    "box": "centre; size along the box's own x, y, z; yaw in radians from x to the box's x, counter-clockwise about z",
    "heading": "true: the box's x points forward; false: along the longer side, one way or the other",
    "track": "x right, y forward, z up in the box's centre; rotations are quaternions w, x, y, z",
    "time": "seconds since the clip's first time step",
}
"""Conventions that every file states."""


def write_objects_json(path: Path, scene: Scene, objects: Sequence[SceneObject], time: float) -> None:
    """Write objects as one JSON file, atomically."""
    content = {
        "format": FORMAT_NAME,
        "version": FORMAT_VERSION,
        "conventions": CONVENTIONS,
        "time": time,
        "origin": _round_numbers(scene.origin),
        "objects": [_describe_object(entry) for entry in objects],
        "tracks": [describe_track(actor) for actor in scene.actors],
    }
    write_bytes(path, (json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode())


def _describe_object(entry: SceneObject) -> dict[str, Any]:
    instance = entry.instance
    fields: dict[str, Any] = {
        "id": instance.id,
        "name": instance.name,
        "class": instance.class_name,
        "codeword": instance.codeword,
        "color": "#{:02x}{:02x}{:02x}".format(*instance.color),
        "count": entry.count,
        "present": entry.present,
        "box": _describe_box(entry.box) | {"heading": entry.track is not None},
        "bounds": {
            "min": _round_numbers(entry.bounds.center - entry.bounds.size / 2),
            "max": _round_numbers(entry.bounds.center + entry.bounds.size / 2),
        },
        "track": None if entry.track is None else entry.track.id,
    }
    if entry.box_in_track is not None:
        fields["box_in_track"] = _describe_box(entry.box_in_track)
    if entry.hull is not None:
        vertices, faces = entry.hull
        fields["hull"] = {"vertices": [_round_numbers(vertex) for vertex in vertices], "faces": faces.tolist()}
    return fields


def _describe_box(box: OrientedBox) -> dict[str, Any]:
    return {"center": _round_numbers(box.center), "size": _round_numbers(box.size), "yaw": round(box.yaw, 6)}


def describe_track(track: Track) -> dict[str, Any]:
    """Describe a track as JSON values."""
    width, length, height = track.dimensions.tolist()
    return {
        "id": track.id,
        "label": track.label,
        "moving": track.moving,
        "size": {"width": width, "length": length, "height": height},
        "times": track.times.tolist(),
        "positions": [_round_numbers(position) for position in track.world_from_box[:, :3, 3]],
        "rotations": np.round(quaternion_from_matrix(track.world_from_box[:, :3, :3]), 9).tolist(),
    }


def _round_numbers(values: ndarray) -> list[float]:
    """Round to a ten-thousandth of a millimetre: more digits say nothing and double the file."""
    return np.round(values, 7).tolist()
