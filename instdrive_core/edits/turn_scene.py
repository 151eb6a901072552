"""Turning the whole scene, e.g. one whose file has y down, so that up is up; and giving it another unit of length."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from jaxtyping import Float64, Int64, UInt16
from numpy import ndarray

from instdrive_core.edits.base import Edit
from instdrive_core.edits.document import Document
from instdrive_core.edits.entries import changed_entries
from instdrive_core.edits.instances import recount, restore_entries
from instdrive_core.edits.parameters import Vector, checked_number, checked_numbers, checked_vector
from instdrive_core.errors import EditError
from instdrive_core.instances.table import Instance
from instdrive_core.maths.rotations import matrix_from_quaternion, quaternion_from_matrix
from instdrive_core.scene.camera import CameraView
from instdrive_core.scene.sky import Sky
from instdrive_core.scene.track import Track
from instdrive_core.scene.transforms import Similarity, composed, rehomed
from instdrive_core.scene.turned import turned_bounds, turned_sky, turned_track, turned_view
from instdrive_core.scene.upright import is_quarter_turn, nearest_axis, snapped, upright_rotation

SCALE_LIMITS = (1e-4, 1e4)
_SAME = 0.5
"""Degrees from an axis below which titles name the axis."""


@dataclass(frozen=True)
class _Before:
    """What a turn replaced."""

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
    _before: _Before | None = field(default=None, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        w, x, y, z = checked_numbers(self.rotation, "rotation", 4)
        self.rotation = (w, x, y, z)
        if math.hypot(*self.rotation) < 1e-6:
            raise EditError("rotation is a quaternion of no length")
        self.scale = checked_number(self.scale, "scale")
        if not SCALE_LIMITS[0] <= self.scale <= SCALE_LIMITS[1]:
            raise EditError(f"scale {self.scale:g} is not from {SCALE_LIMITS[0]:g} to {SCALE_LIMITS[1]:g}")

    @classmethod
    def upright(cls, up: Vector, scale: float = 1.0) -> TurnScene:
        """The turn after which what points along `up` now, of any length above 0, points up."""
        up = checked_vector(up, "up")
        if math.hypot(*up) < 1e-6:
            raise EditError(f"up {up!r} is a vector of no length")
        w, x, y, z = quaternion_from_matrix(upright_rotation(np.array(up))).tolist()
        return cls((w, x, y, z), scale)

    @property
    def linear(self) -> Float64[ndarray, "3 3"]:
        """s R, exact for quarter turns."""
        return self.scale * snapped(matrix_from_quaternion(np.array(self.rotation)))

    @property
    def title(self) -> str:
        """``Turn the scene upright from -y``, ``Scale the scene by 0.01`` …"""
        axis, angle = nearest_axis(self.linear[2])  # what the third row picks becomes z
        turned = not np.array_equal(self.linear, self.scale * np.eye(3))
        scaled = f"by {self.scale:g}" if self.scale != 1 else ""
        if not turned:
            return f"Scale the scene {scaled}".rstrip()
        name = f"Turn the scene, {axis} up" if angle < _SAME else "Turn the scene"
        return f"{name}, and scale it {scaled}" if scaled else name

    def do(self, document: Document) -> bool:
        """Point all rows at composed entries, and replace what is no splat."""
        matrix = np.c_[self.linear, np.zeros(3)]
        if np.array_equal(matrix, np.eye(3, 4)):
            return False
        scene, palette = document.scene, document.transforms
        size = len(palette)
        entries = self._entries(document, matrix)
        before = palette.assign(np.arange(len(scene)), entries)
        table: dict[int, Instance | None] = {entry.id: entry for entry in scene.table}
        first = document.first_tracks
        self._before = _Before(before, size, scene.actors, first, table, scene.views, scene.sky, document.orientation)
        self._turn_tracks(document, matrix)
        scene.views = tuple(turned_view(view, matrix) for view in scene.views)
        if scene.sky is not None:
            scene.sky = turned_sky(scene.sky, self.linear / self.scale)
        document.orientation = composed(matrix, document.orientation)
        self._turn_table(document, matrix)
        document.instances_changed(ids_changed=False)
        return True

    def undo(self, document: Document) -> None:
        """Point the rows back, drop the entries that this edit added, and restore the rest."""
        assert self._before is not None
        before, scene = self._before, document.scene
        document.transforms.assign(np.arange(len(scene)), before.entries)
        document.transforms.truncate(before.palette_size)
        document.set_first_tracks(before.first_tracks)
        document.set_actors(before.actors)
        restore_entries(document, before.table)
        scene.views, scene.sky, document.orientation = before.views, before.sky, before.orientation
        document.instances_changed(ids_changed=False)

    def _entries(self, document: Document, matrix: Similarity) -> UInt16[ndarray, " n"]:
        """Of all rows. An actor's are turned by its track: in the box's frame they only grow."""
        palette, driving = document.transforms, document.scene.nodes > 0
        growth = np.c_[self.scale * np.eye(3), np.zeros(3)]
        groups = [np.flatnonzero(~driving), np.flatnonzero(driving)]
        # One row stands for all that name the same entry: a million of them would take a while to sort.
        named = [_first_rows(palette.indices, rows) for rows in groups]
        new = changed_entries(palette, [(named[0], rehomed(matrix)), (named[1], rehomed(growth))])
        entries = palette.indices.copy()
        for rows, group, found in zip(groups, named, np.split(new, [len(named[0])]), strict=True):
            replaced = np.zeros(len(palette), np.uint16)
            replaced[palette.indices[group]] = found
            entries[rows] = replaced[palette.indices[rows]]
        return entries

    def _turn_tracks(self, document: Document, matrix: Similarity) -> None:
        """A track that was never edited stays the same object as the first one."""
        scene = document.scene
        turned = {id(track): turned_track(track, matrix) for track in (*scene.actors, *document.first_tracks.values())}
        document.set_first_tracks({name: turned[id(track)] for name, track in document.first_tracks.items()})
        document.set_actors(tuple(turned[id(track)] for track in scene.actors))

    def _turn_table(self, document: Document, matrix: Similarity) -> None:
        """Bounds; those of actors lie in the boxes' frames."""
        growth = np.c_[self.scale * np.eye(3), np.zeros(3)]
        for entry in tuple(document.scene.table):
            bounds = turned_bounds(entry.bounds, growth if entry.node else matrix)
            document.scene.table.set(replace(entry, bounds=bounds))
        if not is_quarter_turn(self.linear / self.scale):
            recount(document, [entry.id for entry in document.scene.table if not entry.node])


def _first_rows(entries: UInt16[ndarray, " n"], rows: Int64[ndarray, " m"]) -> Int64[ndarray, " k"]:
    """For each entry that any of `rows` names, one of those rows; in the order of the entries."""
    row_of = np.full(int(entries[rows].max(initial=0)) + 1, -1)
    row_of[entries[rows]] = rows
    return row_of[row_of >= 0]
