"""Where HUGSIM's moving objects were, and which way their boxes stand.

``unicycle_ID.pth`` holds (a, b, v, pitchroll, yaw, h, times, steps), a fitted motion: x, z and y in the world at times
(Zhou et al. 2024, ``utils/dynamic_utils.py`` and ``gaussian_renderer``). ``meta_data.json`` holds the data set's poses,
``frames[].dynamics[ID]`` = world_from_object at ``frames[].timestamp``, and the corners of boxes in ``verts[ID]``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.files.torch_checkpoint import open_torch_checkpoint
from instdrive_core.formats.checkpoints.splat_part import REMEDY

WORLD_UP = np.array([0.0, -1.0, 0.0])
"""HUGSIM's worlds begin at the first front camera: x right, y down, z forward."""
_MOTION = ("a", "b", "v", "pitchroll", "yaw", "h", "times")
_MOST_MOMENTS = 1 << 20
_FARTHEST = 1e9


@dataclass(frozen=True)
class ObjectPath:
    """The poses of an object in its own axes."""

    times: Float64[ndarray, " t"]
    """Seconds, rising."""
    world_from_object: Float64[ndarray, "t 4 4"]


def read_unicycle(path: Path) -> ObjectPath:
    """Read a fitted motion. Raises DataError."""
    file = open_torch_checkpoint(path)
    entries = file.content if isinstance(file.content, tuple | list) else ()
    if len(entries) < len(_MOTION):
        raise DataError(path, f"it holds {len(entries)} arrays, not the 8 of a unicycle model", REMEDY)
    tensors = {name: file.find_tensor(value) for name, value in zip(_MOTION, entries, strict=False)}
    last = tensors["times"]
    count = last.shape[0] if last is not None and len(last.shape) == 1 else 0
    arrays = {}
    for name, tensor in tensors.items():
        shape = (count, 2) if name == "pitchroll" else (count,)
        if tensor is None or tensor.shape != shape or not 0 < count <= _MOST_MOMENTS:
            raise DataError(path, f"{name!r} is no array of numbers over time", REMEDY)
        arrays[name] = tensor.read().astype(np.float64)
        if not (np.abs(arrays[name]) < _FARTHEST).all():  # NaN fails, too
            raise DataError(path, f"{name!r} holds what is no number, or is out of range", REMEDY)
    times = arrays["times"]
    if not (np.diff(times) > 0).all():
        raise DataError(path, "its times do not rise", REMEDY)
    poses = np.tile(np.eye(4), (len(times), 1, 1))
    angles = np.pi / 2 - np.column_stack([arrays["pitchroll"], arrays["yaw"]])
    about_x, about_z, about_y = (_turn_about(axis, angle) for axis, angle in zip("xzy", angles.T, strict=True))
    poses[:, :3, :3] = about_y @ about_z @ about_x
    poses[:, :3, 3] = np.column_stack([arrays["a"], arrays["h"], arrays["b"]])
    return ObjectPath(times, poses)


def collect_written_paths(path: Path, meta: Any) -> dict[str, ObjectPath]:
    """Collect the data set's poses of each object from what ``meta_data.json`` holds. Raises DataError."""
    found: dict[str, dict[float, ndarray]] = {}
    frames = meta.get("frames") if isinstance(meta, Mapping) else None
    for number, frame in enumerate(frames if isinstance(frames, list) else []):
        dynamics = frame.get("dynamics") if isinstance(frame, Mapping) else None
        if not isinstance(dynamics, Mapping) or not dynamics:
            continue
        time = frame.get("timestamp")
        if not isinstance(time, int | float) or isinstance(time, bool) or not abs(time) < _FARTHEST:
            raise DataError(path, f"frames[{number}].timestamp is no time in seconds", REMEDY)
        for name, rows in dynamics.items():
            pose = _read_pose(rows)
            if pose is None:
                raise DataError(path, f"frames[{number}].dynamics[{name[:40]!r}] is no pose of 4 x 4", REMEDY)
            found.setdefault(name, {})[float(time)] = pose
    return {
        name: ObjectPath(np.array(sorted(poses)), np.stack([poses[time] for time in sorted(poses)]))
        for name, poses in found.items()
    }


def collect_boxes(path: Path, meta: Any) -> dict[str, Float64[ndarray, "2 3"]]:
    """Collect the lower and upper corner of each object's box, in its own axes. Raises DataError."""
    found = {}
    corners = meta.get("verts") if isinstance(meta, Mapping) else None
    for name, rows in (corners if isinstance(corners, Mapping) else {}).items():
        points = _read_table(rows, 3)
        if points is None:
            raise DataError(path, f"verts[{name[:40]!r}] holds no corners of a box", REMEDY)
        found[name] = np.stack([points.min(axis=0), points.max(axis=0)])
    return found


def choose_box_turn(motion: ObjectPath, size: Float[ndarray, "3"]) -> Float64[ndarray, "3 3"]:
    """Choose box_from_object: up is the world's, forward the longer side, in the direction in which the object moves.

    Args:
        motion: its poses.
        size: of its box along its own axes.
    """
    rotations = motion.world_from_object[:, :3, :3]
    ups = np.einsum("tij,i->j", rotations, WORLD_UP)
    axis = int(np.abs(ups).argmax())
    up = np.zeros(3)
    up[axis] = 1 if ups[axis] >= 0 else -1
    first, second = (other for other in range(3) if other != axis)
    along = first if size[first] >= size[second] else second
    forward = np.zeros(3)
    steps = np.einsum("tij,ti->tj", rotations[:-1], np.diff(motion.world_from_object[:, :3, 3], axis=0))
    forward[along] = -1 if steps[:, along].sum() < 0 else 1
    return np.stack([np.cross(forward, up), forward, up])


def _turn_about(axis: str, angles: ndarray) -> Float64[ndarray, "t 3 3"]:
    """Turn counter-clockwise about an axis, radians."""
    first, second = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    turns = np.tile(np.eye(3), (len(angles), 1, 1))
    turns[:, first, first] = turns[:, second, second] = np.cos(angles)
    turns[:, second, first] = np.sin(angles)
    turns[:, first, second] = -np.sin(angles)
    return turns


def _read_pose(rows: Any) -> Float64[ndarray, "4 4"] | None:
    pose = _read_table(rows, 4)
    if pose is None or pose.shape != (4, 4) or np.abs(pose[:3, :3]).max() > 2:
        return None
    rotation = pose[:3, :3]
    is_rigid = np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3) and np.linalg.det(rotation) > 0
    return pose if is_rigid else None


def _read_table(rows: Any, width: int) -> Float64[ndarray, "n w"] | None:
    """Rows of finite numbers; None where they are none."""
    if not isinstance(rows, list) or not rows or not all(isinstance(row, list) and len(row) == width for row in rows):
        return None
    if not all(type(value) in (int, float) and abs(value) < _FARTHEST for row in rows for value in row):
        return None
    return np.array(rows, np.float64)
