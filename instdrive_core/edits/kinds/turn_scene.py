"""Turning the whole scene, e.g. one whose file has y down, so that up is up; and giving it another unit of length."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from jaxtyping import Float64, UInt16
from numpy import ndarray

from instdrive_core.edits.bases.parameters import check_number, check_number_list, check_vector
from instdrive_core.edits.bases.relabel import recount_instances, restore_entries
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit
from instdrive_core.edits.document.entries import add_changed_entries
from instdrive_core.edits.document.fingerprint import CONTENT, fingerprint
from instdrive_core.edits.document.frozen_copy import freeze_document
from instdrive_core.edits.document.row_parts import RowParts
from instdrive_core.errors import EditError
from instdrive_core.instances.table import Bounds, Instance
from instdrive_core.maths.rotations import matrix_from_quaternion, quaternion_from_matrix
from instdrive_core.maths.vectors import Vector
from instdrive_core.scene.camera import CameraView
from instdrive_core.scene.pose_transforms import rotate_sky, transform_bounds, transform_track, transform_view
from instdrive_core.scene.sky import Sky
from instdrive_core.scene.track import Track
from instdrive_core.scene.transforms import Similarity, compose_transforms, rebase_entry
from instdrive_core.scene.upright import (
    compute_upright_rotation,
    find_nearest_axis,
    format_axis,
    is_quarter_turn,
    snap_rotation,
)
from instdrive_core.wording import phrase

SCALE_LIMITS = (1e-4, 1e4)
_SAME = 0.5
"""Degrees from an axis below which titles name the axis."""


@dataclass(frozen=True)
class _Before:
    """The parts of a document that a turn replaced."""

    entries: UInt16[ndarray, " n"]
    palette_size: int
    actors: tuple[Track, ...]
    first_tracks: Mapping[str, Track]
    table: dict[int, Instance | None]
    views: tuple[CameraView, ...]
    sky: Sky | None
    orientation: Similarity


@dataclass
class TurnScene(Edit):
    """Turn everything about the coordinate origin and scale it: splats, drives, photos' cameras, sky.

    Hidden, locked and deleted splats go along, too: nothing is moved against anything else. `ResetMoves` leaves it.
    The scene's origin, where its coordinates begin in the world, stays the same.
    """

    kind: ClassVar[str] = "turn_scene"
    rotation: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    """Quaternion wxyz of any length above 0."""
    scale: float = 1.0
    """New metres per old one: 0.01 for a scene in centimetres."""
    _bounds: tuple[bytes, dict[int, Bounds]] | None = field(default=None, init=False, repr=False, compare=False)
    """Bounds of the turned instances by ID, where they have to be computed, and the fingerprint of their document."""
    _before: _Before | None = field(default=None, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        w, x, y, z = check_number_list(self.rotation, "rotation", 4)
        self.rotation = (w, x, y, z)
        if not 1e-6 <= math.hypot(*self.rotation) <= 1e6:
            raise EditError(phrase("rotation {rotation} is a quaternion of no usable length", rotation=self.rotation))
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

    @classmethod
    def make_upright(cls, up: Vector, scale: float = 1.0) -> TurnScene:
        """The turn after which what points along `up` now, of any length above 0, points up."""
        up = check_vector(up, "up")
        if math.hypot(*up) < 1e-6:
            raise EditError(phrase("up {up!r} is a vector of no length", up=up))
        w, x, y, z = quaternion_from_matrix(compute_upright_rotation(np.array(up))).tolist()
        return cls((w, x, y, z), scale)

    @property
    def linear(self) -> Float64[ndarray, "3 3"]:
        """s R, exact for quarter turns."""
        return self.scale * snap_rotation(matrix_from_quaternion(np.array(self.rotation)))

    @property
    def title(self) -> str:
        """``Turn the scene, −Y up``, ``Scale the scene by 0.01`` …"""
        axis, angle = find_nearest_axis(self.linear[2])  # what the third row picks becomes z
        turned = not np.array_equal(self.linear, self.scale * np.eye(3))
        scaled = self.scale != 1
        if not turned:
            return phrase("Scale the scene by {scale:g}", scale=self.scale) if scaled else "Scale the scene"
        name = (
            phrase("Turn the scene, {axis} up", axis=format_axis(axis)) if angle < _SAME else phrase("Turn the scene")
        )
        return phrase("{name}, and scale it by {scale:g}", name=name, scale=self.scale) if scaled else name

    @property
    def is_quick(self) -> bool:
        """Whether `do` is quick without `prepare`: quarter turns are, and mere scaling."""
        return is_quarter_turn(self.linear / self.scale)

    def prepare(self, document: Document) -> None:
        """Compute the bounds after the turn, which may take half a second: `do` on an equal document is then quick.

        Give a frozen copy to do this on another thread.
        """
        if self.is_quick:
            return
        turned = TurnScene(self.rotation, self.scale)
        turned.do(freeze_document(document))
        self._bounds = turned._bounds

    def do(self, document: Document) -> bool:
        """Point all rows at composed entries, and replace what is no splat."""
        matrix = np.c_[self.linear, np.zeros(3)]
        if np.array_equal(matrix, np.eye(3, 4)):
            return False
        key = b"" if self.is_quick else fingerprint(document, CONTENT)
        scene, palette = document.scene, document.transforms
        size = len(palette)
        entries = self._add_entries(document, matrix)
        before = palette.assign(np.arange(len(scene)), entries)
        table: dict[int, Instance | None] = {entry.id: entry for entry in scene.table}
        first = document.first_tracks
        self._before = _Before(before, size, scene.actors, first, table, scene.views, scene.sky, document.orientation)
        self._turn_tracks(document, matrix)
        views = tuple(transform_view(view, matrix) for view in scene.views)
        sky = None if scene.sky is None else rotate_sky(scene.sky, self.linear / self.scale)
        document.replace_surroundings(views, sky, compose_transforms(matrix, document.orientation))
        if self.is_quick:
            self._turn_table(document, matrix)
        else:
            self._recount_bounds(document, key)
        document.note_instances_changed(ids_changed=False)
        return True

    @property
    def _scaling(self) -> Similarity:
        """The scaling in the frames of boxes."""
        return np.c_[self.scale * np.eye(3), np.zeros(3)]

    def undo(self, document: Document) -> None:
        """Point the rows back, drop the entries that this edit added, and restore the rest."""
        assert self._before is not None
        before, scene = self._before, document.scene
        document.transforms.assign(np.arange(len(scene)), before.entries)
        document.transforms.truncate(before.palette_size)
        document.set_first_tracks(before.first_tracks)
        document.set_actors(before.actors)
        restore_entries(document, before.table)
        document.replace_surroundings(before.views, before.sky, before.orientation)
        document.note_instances_changed(ids_changed=False)

    def _add_entries(self, document: Document, matrix: Similarity) -> UInt16[ndarray, " n"]:
        """Add the turned entries of all rows. Tracks turn the actors: in a box's frame splats only grow."""
        nodes = document.scene.nodes
        still, driving = np.flatnonzero(nodes == 0), np.flatnonzero(nodes)
        changes = [
            (RowParts.whole(still), rebase_entry(matrix)),
            (RowParts.whole(driving), rebase_entry(self._scaling)),
        ]
        entries = np.empty(len(nodes), np.uint16)
        entries[np.concatenate([still, driving])] = add_changed_entries(document.transforms, changes)
        return entries

    def _turn_tracks(self, document: Document, matrix: Similarity) -> None:
        """A track that was never edited stays the same object as the first one."""
        scene = document.scene
        turned = {
            id(track): transform_track(track, matrix) for track in (*scene.actors, *document.first_tracks.values())
        }
        document.set_first_tracks({name: turned[id(track)] for name, track in document.first_tracks.items()})
        document.set_actors(tuple(turned[id(track)] for track in scene.actors))

    def _turn_table(self, document: Document, matrix: Similarity) -> None:
        """Turn the bounds by quarter turns; those of actors lie in the boxes' frames."""
        for entry in tuple(document.scene.table):
            bounds = transform_bounds(entry.bounds, self._scaling if entry.node else matrix)
            document.scene.table.set(replace(entry, bounds=bounds))

    def _recount_bounds(self, document: Document, key: bytes) -> None:
        """Compute the bounds of what stands askew now, or take those from the last time."""
        table = document.scene.table
        if self._bounds is None or self._bounds[0] != key:
            recount_instances(document, [entry.id for entry in table if entry.count])
            self._bounds = key, {entry.id: entry.bounds for entry in table}
        for entry in tuple(table):
            table.set(replace(entry, bounds=self._bounds[1][entry.id]))
