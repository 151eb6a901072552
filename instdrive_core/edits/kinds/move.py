"""Moving, turning and scaling instances. Of a moving actor the track is edited."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.edits.bases.editable import check_unlocked, find_editable_parts
from instdrive_core.edits.bases.parameters import (
    check_ids,
    check_number,
    check_number_list,
    check_switch,
    check_vector,
)
from instdrive_core.edits.bases.poses import PoseEdit
from instdrive_core.edits.bases.relabel import get_instance
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import describe_ids
from instdrive_core.edits.document.entries import add_changed_entries
from instdrive_core.edits.document.row_parts import RowParts
from instdrive_core.edits.queries.placement import compute_bottom, compute_center, find_ground_below, find_lane
from instdrive_core.errors import EditError
from instdrive_core.maths.rotations import matrix_from_quaternion
from instdrive_core.maths.vectors import Vector
from instdrive_core.scene.track import Track
from instdrive_core.scene.transforms import Similarity, move_entry
from instdrive_core.wording import phrase

SCALE_LIMITS = (0.01, 100.0)


@dataclass
class MoveInstances(PoseEdit):
    """Move instances together: scaled and turned about a pivot, then shifted.

    An actor's whole path is moved so, except that scaling changes the object only, not how far it drives, and that the
    path need not turn along; every instance of the actor goes along.
    """

    kind: ClassVar[str] = "move_instances"
    ids: tuple[int, ...]
    translation: Vector = (0.0, 0.0, 0.0)
    """Metres, in the world."""
    rotation: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    """Quaternion wxyz, in the world, of any length above 0."""
    scale: float = 1.0
    pivot: Vector | None = None
    """World point that is not moved by turning and scaling; None = the centre of the instances."""
    time: float = 0.0
    """Seconds: where moving actors are when they are moved."""
    yaw_only: bool = False
    """Turn about the vertical axis only."""
    along_lane: bool = False
    """Shift along the lane only."""
    on_ground: bool = False
    """Set down on the ground at the new place."""
    body_only: bool = False
    """Turn what drives on its path, which is shifted but not turned; otherwise the whole drive turns."""

    def __post_init__(self) -> None:
        self.ids = check_ids(self.ids)
        self.translation = check_vector(self.translation, "translation")
        self.pivot = None if self.pivot is None else check_vector(self.pivot, "pivot")
        turn = check_number_list(self.rotation, "rotation", 4)
        self.rotation = (turn[0], turn[1], turn[2], turn[3])
        if not 1e-6 <= math.hypot(*self.rotation) <= 1e6:
            raise EditError(phrase("rotation {rotation} is a quaternion of no usable length", rotation=self.rotation))
        self.time = check_number(self.time, "time")
        self.scale = check_number(self.scale, "scale")
        if not SCALE_LIMITS[0] <= self.scale <= SCALE_LIMITS[1]:
            raise EditError(
                phrase(
                    "scale {scale:g} is not from {least:g} to {most:g}",
                    scale=self.scale,
                    least=SCALE_LIMITS[0],
                    most=SCALE_LIMITS[1],
                )
            )
        for name in ("yaw_only", "along_lane", "on_ground", "body_only"):
            check_switch(getattr(self, name), name)

    @property
    def title(self) -> str:
        """``Move instance 17``, ``Rotate instance 17``, ``Scale instance 17`` or ``Put instance 17 on the ground``."""
        what, shifted = describe_ids(self.ids), any(self.translation)
        turned = math.hypot(*self.rotation[1:]) > 1e-9 * math.hypot(*self.rotation)
        if shifted or (turned and self.scale != 1):
            return phrase("Move {what}", what=what)
        if turned or self.scale != 1:
            return phrase("Rotate {what}", what=what) if turned else phrase("Scale {what}", what=what)
        return phrase("Put {what} on the ground", what=what) if self.on_ground else phrase("Move {what}", what=what)

    def do(self, document: Document) -> bool:
        """Point rows at composed transforms, and replace tracks."""
        free = find_editable_parts(document, self.ids)
        matrix = self.compute_matrix(document)
        if np.array_equal(matrix, np.eye(3, 4)):
            return False
        node_of = {number: get_instance(document, number).node for number in self.ids}
        nodes = sorted(set(node_of.values()) - {0})
        sharing = [entry.id for entry in document.scene.table if entry.node in nodes]
        check_unlocked(document, sharing)
        still = free.filter(document.scene.nodes[free.rows] == 0)  # of an actor, its strays
        changes = [(still, move_entry(matrix))]
        if nodes and self.scale != 1:
            # An actor's path takes the rigid part; its splats, in their box frame, only the size.
            driving = np.flatnonzero(np.isin(document.scene.nodes, nodes))
            changes.append((RowParts.whole(driving), move_entry(self.scale * np.eye(3, 4))))
        size_before = len(document.transforms)
        entries = add_changed_entries(document.transforms, changes)
        rows = np.concatenate([parts.rows for parts, _ in changes])
        touched = [entry.id for entry in document.scene.table if entry.node in nodes or node_of.get(entry.id) == 0]
        move = move_body if self.body_only else move_track
        tracks = {node: move(document.scene.actors[node - 1], matrix, self.scale, self.time) for node in nodes}
        self.assign_poses(document, rows, entries, tracks, touched, size_before, matrix)
        return True

    def compute_matrix(self, document: Document) -> Similarity:
        """[s R | t] in the world, with all constraints. Raises EditError where ground or lane cannot be found."""
        w, x, y, z = self.rotation
        if self.yaw_only:
            # The twist about z of the swing-twist decomposition; a half turn about a level axis has none.
            w, x, y, z = (w, 0.0, 0.0, z) if math.hypot(w, z) > 1e-9 else (1.0, 0.0, 0.0, 0.0)
        fixed = None if self.pivot is None else np.array(self.pivot)
        # Of thousands of instances the centre takes a while.
        free = fixed is not None and not (self.along_lane or self.on_ground)
        center = fixed if fixed is not None and free else compute_center(document, self.ids, self.time)
        pivot = center if fixed is None else fixed
        shift = np.array(self.translation)
        if self.along_lane:
            lane = find_lane(document, self.ids, center, self.time)
            shift = lane * (lane @ shift)
        linear = self.scale * matrix_from_quaternion(np.array([w, x, y, z]))
        matrix = np.c_[linear, pivot + shift - linear @ pivot]
        if self.on_ground:
            place = matrix[:, :3] @ center + matrix[:, 3]
            matrix[2, 3] += find_ground_below(document, self.ids, place) - compute_bottom(
                document, self.ids, matrix, self.time
            )
        return matrix


def move_track(track: Track, matrix: Similarity, scale: float, time: float) -> Track:
    """The track moved as a rigid path, so that where it is at `time` (seconds) goes where `matrix` = [s R | t] says."""
    rotation: Float64[ndarray, "3 3"] = matrix[:, :3] / scale
    here = track.interpolate_pose(time)[:3, 3]
    poses = track.world_from_box.copy()
    poses[:, :3, :3] = rotation @ poses[:, :3, :3]
    poses[:, :3, 3] = (poses[:, :3, 3] - here) @ rotation.T + matrix[:, :3] @ here + matrix[:, 3]
    return replace(track, world_from_box=poses, dimensions=track.dimensions * scale)


def move_body(track: Track, matrix: Similarity, scale: float, time: float) -> Track:
    """The track with its box turned alike at all times, so that at `time` (seconds) it is where `matrix` = [s R | t]
    says; the path keeps its shape and direction."""
    here = track.interpolate_pose(time)
    turn = here[:3, :3].T @ (matrix[:, :3] / scale) @ here[:3, :3]
    poses = track.world_from_box.copy()
    poses[:, :3, :3] = poses[:, :3, :3] @ turn
    poses[:, :3, 3] += matrix[:, :3] @ here[:3, 3] + matrix[:, 3] - here[:3, 3]
    return replace(track, world_from_box=poses, dimensions=track.dimensions * scale)
