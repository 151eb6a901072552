"""The base class of edits that add splats: rows at the end, which undo takes away again."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import UInt16
from numpy import ndarray

from instdrive_core.edits.bases.relabel import add_entries, restore_entries
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit
from instdrive_core.edits.document.entries import add_changed_entries
from instdrive_core.edits.document.frozen_copy import freeze_colored
from instdrive_core.edits.document.row_parts import RowParts
from instdrive_core.edits.document.versions import DocumentVersions
from instdrive_core.errors import EditError
from instdrive_core.instances.table import Instance
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.track import Track
from instdrive_core.scene.transforms import move_entry
from instdrive_core.wording import phrase

MAX_NODES = 1 << 16
"""Nodes are named with 16 bits."""


@dataclass(frozen=True)
class Addition:
    """Splats to be added, with everything that they name."""

    scene: Scene
    """Rows with final instance IDs and nodes; SH and feature columns as the document's. Its tracks do not count."""
    colors: UInt16[ndarray, " n"]
    """Entry of the document's colour palette for each row."""
    transforms: UInt16[ndarray, " n"]
    """Entry of the document's transform palette for each row, before the shift."""
    entries: tuple[Instance, ...]
    """Table entries of the new instances, and of those that grow; counted when they are added."""
    tracks: tuple[Track, ...] = ()
    """Tracks of the new nodes, which are numbered after the existing ones."""


@dataclass(frozen=True)
class _Ready:
    """What lies behind the document's rows already, copied beside the window or kept by undo, and when that holds."""

    document: Document
    key: tuple[DocumentVersions, int, int]
    addition: Addition
    grown: dict[str, ndarray]
    counted: tuple[Instance, ...] | None
    """The new instances as the table will have them; None where they are not counted yet."""
    rehearsal: Document | None = None
    """A copy in which it was done, which knows the rows of all instances; None where undo kept this."""


def _make_key(document: Document) -> tuple[DocumentVersions, int, int]:
    return document.versions, document.first_free_id, document.spare_writes


@dataclass
class AppendEdit(Edit):
    """An edit that adds splats: subclasses say which, this class appends them and takes them away again."""

    _count: int = field(default=0, init=False, repr=False, compare=False)
    _table_before: dict[int, Instance | None] = field(default_factory=dict, init=False, repr=False, compare=False)
    _actors_before: tuple[Track, ...] = field(default=(), init=False, repr=False, compare=False)
    _size_before: int = field(default=1, init=False, repr=False, compare=False)
    _free_before: int = field(default=1, init=False, repr=False, compare=False)
    _counted: tuple[Instance, ...] = field(default=(), init=False, repr=False, compare=False)
    _ready: _Ready | None = field(default=None, init=False, repr=False, compare=False)
    _parts: tuple[ndarray, ndarray, tuple[Instance, ...], tuple[Track, ...]] | None = field(
        default=None, init=False, repr=False, compare=False
    )

    @property
    def added_ids(self) -> tuple[int, ...]:
        """IDs of the instances that were added, once it was done; not of those that only grew."""
        return tuple(number for number, entry in self._table_before.items() if entry is None)

    @abstractmethod
    def build_addition(self, document: Document) -> Addition:
        """What this edit adds, not shifted yet. Raises EditError where the edit does not fit the document."""

    @property
    @abstractmethod
    def shift(self) -> tuple[float, float, float]:
        """Metres in the world by which everything added is moved."""

    def prepare(self, document: Document) -> None:
        """Copy and count what will be added: doing it is then quick, as long as the document does not change meanwhile.

        It only reads the document, so another thread may do it while nothing is edited. Raises EditError where the
        edit does not fit.
        """
        added = self.build_addition(document)
        grown = document.grow_gaussians(added.scene)
        rehearsal = freeze_colored(document)
        self._ready = _Ready(rehearsal, _make_key(rehearsal), added, grown, None)
        self.do(rehearsal)
        rehearsal.count_states()  # builds the index of instances
        self._ready = _Ready(document, _make_key(document), added, grown, self._counted, rehearsal)

    def do(self, document: Document) -> bool:
        """Append rows, tracks and entries of the table."""
        ready, self._ready = self._ready, None
        if ready is not None and (ready.document is not document or ready.key != _make_key(document)):
            ready = None
        added = ready.addition if ready is not None else self.build_addition(document)
        if len(document.scene.actors) + len(added.tracks) >= MAX_NODES:
            raise EditError(phrase("a scene has at most {most} moving objects", most=MAX_NODES - 1))
        rows = len(document.scene) + np.arange(len(added.scene))
        self._count, self._actors_before = len(rows), document.scene.actors
        self._size_before, self._free_before = len(document.transforms), document.first_free_id
        document.set_actors((*document.scene.actors, *(_shift_track(track, self.shift) for track in added.tracks)))
        document.append_rows(added.scene, ready.grown if ready is not None else None)
        document.colors.assign(rows, added.colors)
        document.transforms.assign(rows, added.transforms)
        still = rows[added.scene.nodes == 0]
        if any(self.shift) and len(still):
            self._shift_rows(document, still)
        table = document.scene.table.instances
        self._table_before = {entry.id: table.get(entry.id) for entry in added.entries}
        self._parts = added.colors, added.transforms, added.entries, added.tracks
        self._counted = add_entries(document, added.entries, ready.counted if ready is not None else None)
        if ready is not None and ready.rehearsal is not None:
            document.adopt_instance_index(ready.rehearsal)
        return True

    def undo(self, document: Document) -> None:
        """Take away what was added; its splats are kept in place for redo, until others are added."""
        scene, rows = document.scene, slice(len(document.scene) - self._count, len(document.scene))
        kept = Scene(
            scene.gaussians.select(rows),
            scene.instance_ids[rows],
            scene.codewords[rows],
            scene.nodes[rows],
            actors=scene.actors,
            extra={name: column[rows] for name, column in scene.extra.items()},
        )
        restore_entries(document, self._table_before)
        document.drop_rows(self._count)
        document.transforms.truncate(self._size_before)
        document.set_actors(self._actors_before)
        document.first_free_id = self._free_before
        if self._parts is not None:
            buffers = document.find_gaussian_buffers()
            self._ready = _Ready(document, _make_key(document), Addition(kept, *self._parts), buffers, self._counted)

    def _shift_rows(self, document: Document, rows: ndarray) -> None:
        change = move_entry(np.c_[np.eye(3), np.array(self.shift)])
        self._parts = None
        try:
            entries = add_changed_entries(document.transforms, [(RowParts.whole(rows), change)])
        except EditError:
            self._table_before = {}
            self.undo(document)
            raise
        document.transforms.assign(rows, entries)


def make_unique_track_id(wanted: str, taken: set[str]) -> str:
    """`wanted`, or `wanted` and a number where another track has that ID."""
    name, number = wanted, 1
    while name in taken:
        number += 1
        name = f"{wanted} {number}"
    return name


def _shift_track(track: Track, shift: tuple[float, float, float]) -> Track:
    poses = track.world_from_box.copy()
    poses[:, :3, 3] += shift
    return replace(track, world_from_box=poses)
