"""Moving objects of several pieces: one node for each track, made of what each piece saw of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64, Int64
from numpy import ndarray
from scipy.spatial import KDTree

from instdrive_core.maths.rotations import (
    multiply_quaternions,
    normalize_quaternions,
    quaternion_from_matrix,
)
from instdrive_core.scene.gaussians import Gaussians, concatenate_gaussians
from instdrive_core.scene.track import Track

REACH = 0.25
"""Metres around the Gaussians of the piece that saw an object best, where those of other pieces would double them."""


@dataclass(frozen=True)
class ActorPart:
    """What one piece made of a moving object."""

    piece: int
    track: Track
    """With the piece's corrections."""
    gaussians: Gaussians
    """In the box frame of `track`."""
    instance_ids: Int64[ndarray, " n"]
    closeness: float
    """How well the piece saw it; see `measure_closeness`."""
    span: tuple[float, float]
    """Seconds from the first to the last photo of the piece's own stretch."""


@dataclass(frozen=True)
class JoinedActor:
    """A moving object over the whole drive."""

    track: Track
    gaussians: Gaussians
    parts: tuple[int, ...]
    """Piece that each of its instances comes from, beside `instances`."""
    instances: tuple[int, ...]
    """IDs that pieces gave it: all are one."""


def join_actor(parts: Sequence[ActorPart]) -> JoinedActor:
    """Join what pieces made of one moving object; `parts` is not empty and in the order of the drive.

    The Gaussians of the piece that saw it best stay, with those of others where it has none: sides that it did not
    see. Each pose comes from the piece that owns its time, moved to the frame of the Gaussians that stay.
    """
    order = sorted(parts, key=lambda part: -part.closeness)
    best, kept = order[0], [order[0].gaussians]
    poses = best.track.world_from_box.copy()
    for part in order[1:]:
        shift = _find_shift(best, part)
        mine = (best.track.times >= part.span[0]) & (best.track.times <= part.span[1])
        poses[mine] = part.track.world_from_box[mine] @ shift
        moved = _move(part.gaussians, np.linalg.inv(shift))
        held = np.concatenate([gaussians.means for gaussians in kept])
        free = np.ones(len(moved), bool) if not len(held) else KDTree(held).query(moved.means)[0] > REACH
        kept.append(moved.select(free & _find_inside(moved, best.track)))
    pairs = [
        (part.piece, int(number)) for part in parts for number in np.unique(part.instance_ids[part.instance_ids > 0])
    ]
    return JoinedActor(
        replace(best.track, world_from_box=poses),
        concatenate_gaussians(kept),
        tuple(piece for piece, _ in pairs),
        tuple(number for _, number in pairs),
    )


def _find_shift(best: ActorPart, other: ActorPart) -> Float64[ndarray, "4 4"]:
    """Where the frame of the best piece's box lies in the other's: the same Gaussians may sit a little elsewhere in
    boxes that were corrected elsewhere. The middle one of the poses at the border of both."""
    times, (start, end) = best.track.times, other.span
    gap = np.maximum(np.maximum(times - end, start - times), 0)
    own = np.maximum(np.maximum(times - best.span[1], best.span[0] - times), 0)
    near = int(np.argmin(gap + own))
    rows = slice(max(0, near - 2), near + 3)
    between = np.linalg.solve(other.track.world_from_box[rows], best.track.world_from_box[rows])
    distance = np.linalg.norm(between[:, :3, 3] - np.median(between[:, :3, 3], axis=0), axis=1)
    return between[int(np.argmin(distance))]


def _move(gaussians: Gaussians, pose: Float64[ndarray, "4 4"]) -> Gaussians:
    """Turn and shift Gaussians; view-dependent colours turn too little to matter, boxes are corrected by degrees."""
    turn = np.tile(quaternion_from_matrix(pose[:3, :3]), (len(gaussians), 1))
    return replace(
        gaussians,
        means=(gaussians.means @ pose[:3, :3].T + pose[:3, 3]).astype(np.float32),
        quats=multiply_quaternions(turn, normalize_quaternions(gaussians.quats)).astype(np.float32),
    )


def _find_inside(gaussians: Gaussians, track: Track) -> ndarray:
    return np.all(np.abs(gaussians.means) <= track.dimensions / 2 + REACH, axis=1)
