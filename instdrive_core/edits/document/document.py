"""A scene being edited."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float32, Int, Int64, UInt32
from numpy import ndarray

from instdrive_core.edits.document.edit import Edit
from instdrive_core.edits.document.history import History
from instdrive_core.edits.document.row_index import RowIndex
from instdrive_core.edits.document.row_kernels import count_flags
from instdrive_core.edits.document.row_parts import RowParts
from instdrive_core.edits.document.versions import DocumentVersions
from instdrive_core.errors import EditError
from instdrive_core.scene.camera import CameraView
from instdrive_core.scene.dirty_rows import DirtyRows
from instdrive_core.scene.palette import ColorPalette
from instdrive_core.scene.row_buffers import RowBuffers
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.selection import Flag, SplatState
from instdrive_core.scene.sky import Sky
from instdrive_core.scene.track import Track
from instdrive_core.scene.transforms import Similarity, TransformPalette, compute_current_means


@dataclass(frozen=True)
class InstanceSummary:
    """How many splats of one instance are in which state."""

    count: int
    """All of them, deleted ones included."""
    deleted: int
    hidden: int
    locked: int
    selected: int
    drawn: int
    """Neither hidden nor deleted."""

    @property
    def is_deleted(self) -> bool:
        """Every splat is deleted."""
        return self.deleted == self.count

    @property
    def is_hidden(self) -> bool:
        """Splats are left, and none of them is drawn."""
        return not self.is_deleted and self.drawn == 0

    @property
    def is_locked(self) -> bool:
        """Every splat that is left is locked."""
        return not self.is_deleted and self.locked >= self.count - self.deleted


@dataclass(frozen=True)
class InstanceCounts:
    """`InstanceSummary` of all instances at once: row k of each array belongs to ``ids[k]``."""

    ids: UInt32[ndarray, " m"]
    count: Int64[ndarray, " m"]
    deleted: Int64[ndarray, " m"]
    hidden: Int64[ndarray, " m"]
    locked: Int64[ndarray, " m"]
    selected: Int64[ndarray, " m"]
    drawn: Int64[ndarray, " m"]


class DeferredWork(ABC):
    """Work that an edit leaves to `Document.run_deferred`."""

    @abstractmethod
    def do(self, document: Document, rows: int | None) -> bool:
        """Do the work for about so many rows, None = all of it; returns whether all is done."""


class Document:
    """A scene with its edit state, palettes of colours and moves, and history.

    All that the editor shows changes through `apply`.
    """

    def __init__(self, scene: Scene, first_free_id: int | None = None, like: Document | None = None) -> None:
        """Begin to edit a scene.

        Args:
            scene: What is edited.
            first_free_id: Where IDs of instances that are gone are not to be given again, the first never used.
            like: A document of the same splats whose edit state and moves, but not colours, are taken over.
        """
        self.scene = scene
        self.state = SplatState(len(scene)) if like is None else like.state.fork()
        self.colors = ColorPalette(len(scene)) if like is None else like.fork_plain_colors()
        self.transforms = TransformPalette(len(scene)) if like is None else like.transforms.fork()
        self.history = History()
        self.open_scene: Callable[[Path], Scene] | None = None
        """Opens the files that edits insert; set by whoever knows formats."""
        self._buffers = RowBuffers()
        self.orientation: Similarity = np.eye(3, 4)
        """From the file's axes to the world's: what turned the whole scene. Written by `replace_surroundings`."""
        self._rows_version = self._track_version = self._table_version = self._surroundings_version = 0
        self.new_rows = DirtyRows(len(scene))
        """Rows that were added or replaced, for whoever holds copies of the stored parameters."""
        self.first_free_id = _find_first_free_id(scene) if first_free_id is None else first_free_id
        """No splat has or had this instance ID or a higher one; written by `bases/relabel.py`."""
        self.can_defer_bounds = False
        """Whether moves of very many instances may leave their bounds for later; who sets it calls `run_deferred`."""
        self._outermost: Edit | None = None
        self.deferred: DeferredWork | None = None
        """Work that the last edit has deferred and that is not done yet."""
        self._first_tracks = {track.id: track for track in scene.actors}
        self._by_instance: RowIndex | None = None
        self._by_codeword: RowIndex | None = None
        self._counts: tuple[int, InstanceCounts] | None = None
        self._kept_ids: tuple[tuple[int, int], UInt32[ndarray, " n"]] | None = None
        self._plain_colors: ColorPalette | None = None

    @property
    def versions(self) -> DocumentVersions:
        """Counters of all changes so far: another value means that something visible may be different."""
        return DocumentVersions(
            self._rows_version,
            self.state.version,
            self.colors.version,
            self.transforms.version,
            self._track_version,
            self._table_version,
            self._surroundings_version,
        )

    def keep_instance_ids(self) -> UInt32[ndarray, " n"]:
        """Keep a copy of the instance IDs as they are now, the same one until they change; nobody may write to it."""
        key = self._rows_version, self._table_version
        if self._kept_ids is None or self._kept_ids[0] != key:
            self._kept_ids = key, self.scene.instance_ids.copy()
        return self._kept_ids[1]

    def fork_plain_colors(self) -> ColorPalette:
        """Make a palette for these splats that changes no colour; it shares memory with others of its kind."""
        if len(self.colors) == 1:
            return self.colors.fork()
        if self._plain_colors is None or len(self._plain_colors.indices) != len(self.scene):
            self._plain_colors = ColorPalette(len(self.scene))
        return self._plain_colors.fork()

    def adopt_instance_index(self, other: Document) -> None:
        """Take over the index of instances of a document with the same instance IDs, where it has been built."""
        self._by_instance = other._by_instance

    def apply(self, edit: Edit, gesture: str | None = None) -> None:
        """Do an edit and push it on the history; one that changes nothing is not pushed.

        Edits of the same `gesture` (a unique name per slider drag) become one step.
        Raises EditError, with nothing changed, where the edit does not fit the scene.
        """
        if not self.history.continues_gesture(gesture):  # else the edit that deferred it is undone first
            self.run_deferred()
        self._outermost = edit
        self.history.apply(edit, self, gesture)

    def extend_last(self, edit: Edit) -> None:
        """Put an edit that goes on where the last one ended in its place, as `History.extend_last` does."""
        self.run_deferred()
        self._outermost = edit
        self.history.extend_last(edit, self)

    def undo(self) -> Edit | None:
        """Undo one step; returns its edit, or None where nothing is left."""
        return self.history.undo(self)

    def redo(self) -> Edit | None:
        """Redo one step; returns its edit, or None where nothing is left."""
        self.run_deferred()
        self._outermost = self.history.next
        return self.history.redo(self)

    def defer(self, edit: Edit, work: DeferredWork) -> bool:
        """Leave work of an edit to `run_deferred`; returns False where it must be done at once.

        Only the edit that was done last may defer anything, and no part of another edit.
        """
        if not self.can_defer_bounds or edit is not self._outermost:
            return False
        self.deferred = work
        return True

    def drop_deferred(self) -> None:
        """Forget the deferred work: its edit is undone."""
        self.deferred = None

    def run_deferred(self, rows: int | None = None) -> None:
        """Do the work that the last edit deferred: all of it, or about as much as concerns so many rows."""
        if self.deferred is not None and self.deferred.do(self, rows):
            self.deferred = None

    def find_rows(self, instance_ids: Iterable[int]) -> Int64[ndarray, " k"]:
        """Rows of any of these instances, rising, deleted ones included. Raises EditError for an unknown ID."""
        ids = self._check_known(instance_ids)
        return self._get_instance_index().rows(ids)

    def find_row_parts(self, instance_ids: Sequence[int]) -> RowParts:
        """The rows of each of these instances, one after the other, deleted ones included.

        Raises EditError for an unknown ID.
        """
        ids = self._check_known(instance_ids)
        return RowParts(*self._get_instance_index().parts(ids))

    def find_codeword_rows(self, codeword: int) -> Int64[ndarray, " k"]:
        """Rows with this codeword, rising, deleted ones included; none where the scene has no codewords."""
        if not self.scene.code_bits:
            return np.zeros(0, np.int64)
        if self._by_codeword is None:
            self._by_codeword = RowIndex(self.scene.codewords)
        return self._by_codeword.rows((codeword,))

    def compute_means(self, rows: Int[ndarray, " k"]) -> Float32[ndarray, "k 3"]:
        """Means with their moves applied, metres, in the frames of the rows' nodes."""
        return compute_current_means(self.scene.gaussians, self.transforms, rows)

    def replace_tracks(self, tracks: Mapping[int, Track]) -> None:
        """Give actors other tracks; keys are nodes, from 1."""
        self.set_actors(tuple(tracks.get(node, track) for node, track in enumerate(self.scene.actors, start=1)))

    def set_actors(self, actors: tuple[Track, ...]) -> None:
        """Replace the list of actors; node k is ``actors[k - 1]``."""
        known = {track.id for track in self.scene.actors}
        self._first_tracks |= {track.id: track for track in actors if track.id not in known}
        self.scene.actors = actors
        self._track_version += 1

    def get_first_track(self, node: int) -> Track:
        """An actor's track before any edit of it: as it came with the scene, or with the edit that added it."""
        return self._first_tracks[self.scene.actors[node - 1].id]

    @property
    def first_tracks(self) -> Mapping[str, Track]:
        """Tracks before any edit of them, by ID."""
        return dict(self._first_tracks)

    def set_first_tracks(self, tracks: Mapping[str, Track]) -> None:
        """Replace the tracks from before any edit: for edits of the whole scene, which are no edits of one track."""
        self._first_tracks = dict(tracks)

    def replace_surroundings(self, views: tuple[CameraView, ...], sky: Sky | None, orientation: Similarity) -> None:
        """Replace the photos' cameras, the sky, and what turned the whole scene: for edits of the whole scene."""
        self.scene.views, self.scene.sky, self.orientation = views, sky, orientation
        self._surroundings_version += 1

    def grow_gaussians(self, added: Scene) -> dict[str, ndarray]:
        """Copy all parameters, and those to be added, to where `append_rows` finds them; changes nothing in use.

        That is most of the work, and another thread may do it, as long as nobody adds splats meanwhile.
        """
        arrays = self.scene.gaussians.arrays()
        return {name: self._buffers.grow(name, array, getattr(added.gaussians, name)) for name, array in arrays.items()}

    def find_gaussian_buffers(self) -> dict[str, ndarray]:
        """Find the buffers behind all parameters, in which those of rows just dropped still lie behind the end."""
        arrays = self.scene.gaussians.arrays()
        return {name: buffer for name in arrays if (buffer := self._buffers.find(name, arrays[name])) is not None}

    @property
    def spare_writes(self) -> int:
        """Rises when something is written behind the rows' end, be it taken into the scene or not."""
        return self._buffers.writes

    def append_rows(self, added: Scene, grown: Mapping[str, ndarray] | None = None) -> None:
        """Add splats at the end, neither coloured nor moved, with no state bit set; for `AppendEdit`.

        SH, feature and extra columns must be the scene's, nodes those of its actors.

        Args:
            grown: What `grow_gaussians` made for the same splats, with no others added since.
        """
        scene, count, grown = self.scene, len(added), grown or {}
        for name, array in scene.gaussians.arrays().items():
            tail = getattr(added.gaussians, name)
            setattr(scene.gaussians, name, self._buffers.extend(name, array, tail, grown.get(name)))
        for name in ("instance_ids", "codewords", "nodes"):
            setattr(scene, name, self._buffers.extend(name, getattr(scene, name), getattr(added, name)))
        for name, column in scene.extra.items():
            scene.extra[name] = self._buffers.extend(f"extra {name}", column, added.extra[name])
        for part in (self.state, self.colors, self.transforms):
            part.append(count)
        self.new_rows.touch(len(scene) - count, len(scene))
        self._note_rows_changed()

    def drop_rows(self, count: int) -> None:
        """Take the last `count` splats away; the inverse of `append_rows`."""
        scene, left = self.scene, len(self.scene) - count
        for name, array in scene.gaussians.arrays().items():
            setattr(scene.gaussians, name, array[:left])
        for name in ("instance_ids", "codewords", "nodes"):
            setattr(scene, name, getattr(scene, name)[:left])
        for name, column in scene.extra.items():
            scene.extra[name] = column[:left]
        for part in (self.state, self.colors, self.transforms):
            part.drop_rows(count)
        self.new_rows.shorten(left)
        self._note_rows_changed()

    def _note_rows_changed(self) -> None:
        self._by_codeword = None
        self._rows_version += 1
        self.note_instances_changed(ids_changed=True)

    def count_states(self) -> InstanceCounts:
        """The states of all instances, counted once per change of state or IDs."""
        if self._counts is None or self._counts[0] != self.state.version:
            self._counts = (self.state.version, self._count_states())
        return self._counts[1]

    def summarize_instance(self, instance_id: int) -> InstanceSummary:
        """The states of one instance's splats. Raises EditError for an unknown ID."""
        counts = self.count_states()
        position = int(np.searchsorted(counts.ids, instance_id))
        if instance_id not in self.scene.table:
            raise EditError(f"the scene has no instance {instance_id}")
        if position == len(counts.ids) or counts.ids[position] != instance_id:
            return InstanceSummary(0, 0, 0, 0, 0, 0)
        columns = (counts.count, counts.deleted, counts.hidden, counts.locked, counts.selected, counts.drawn)
        return InstanceSummary(*(int(column[position]) for column in columns))

    def find_selected_instances(self) -> tuple[int, ...]:
        """Instances with any selected splat, rising."""
        counts = self.count_states()
        return tuple(counts.ids[counts.selected > 0].tolist())

    def find_visible_instances(self) -> tuple[int, ...]:
        """Instances with any splat that is neither hidden nor deleted, rising."""
        counts = self.count_states()
        return tuple(counts.ids[counts.drawn > 0].tolist())

    def note_instances_changed(self, ids_changed: bool) -> None:
        """Take note that an edit changed the table, and with `ids_changed` that it wrote `scene.instance_ids` too."""
        self._table_version += 1
        if ids_changed:
            self._by_instance, self._counts = None, None

    def _check_known(self, instance_ids: Iterable[int]) -> tuple[int, ...]:
        ids = tuple(instance_ids)
        unknown = [instance_id for instance_id in ids if instance_id not in self.scene.table]
        if unknown:
            raise EditError(f"the scene has no instance {unknown[0]}; its {len(self.scene.table)} IDs are in the table")
        return ids

    def _get_instance_index(self) -> RowIndex:
        if self._by_instance is None:
            self._by_instance = RowIndex(self.scene.instance_ids)
        return self._by_instance

    def _count_states(self) -> InstanceCounts:
        index = self._get_instance_index()
        numbers = count_flags(index.group_of_row, self.state.flags, len(index.keys))

        def with_flag(flag: Flag) -> Int64[ndarray, " m"]:
            return numbers[:, (np.arange(16) & flag) != 0].sum(axis=1)

        columns = {
            "count": index.counts,
            "deleted": with_flag(Flag.DELETED),
            "hidden": with_flag(Flag.HIDDEN),
            "locked": with_flag(Flag.LOCKED),
            "selected": with_flag(Flag.SELECTED),
            "drawn": index.counts - with_flag(Flag.HIDDEN | Flag.DELETED),
        }
        real = index.keys > 0
        return InstanceCounts(index.keys[real], **{name: column[real] for name, column in columns.items()})


def _find_first_free_id(scene: Scene) -> int:
    named = max((instance.id for instance in scene.table), default=0)
    return max(named, int(scene.instance_ids.max(initial=0))) + 1
