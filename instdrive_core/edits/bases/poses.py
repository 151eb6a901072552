"""The base class of edits that move things: entries of the transform palette, and tracks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Int, UInt16
from numpy import ndarray

from instdrive_core.edits.bases.deferred_bounds import MANY, DeferredBounds
from instdrive_core.edits.bases.relabel import recount_instances, restore_entries
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit
from instdrive_core.instances.table import Instance
from instdrive_core.scene.track import Track
from instdrive_core.scene.transforms import Similarity


@dataclass
class PoseEdit(Edit):
    """An edit of positions: subclasses say which rows name which entries, and which tracks there are."""

    _rows: ndarray | None = field(default=None, init=False, repr=False, compare=False)
    _before: ndarray | None = field(default=None, init=False, repr=False, compare=False)
    _size_before: int = field(default=1, init=False, repr=False, compare=False)
    _table_before: dict[int, Instance | None] = field(default_factory=dict, init=False, repr=False, compare=False)
    _deferred_bounds: DeferredBounds | None = field(default=None, init=False, repr=False, compare=False)
    _tracks_before: dict[int, Track] = field(default_factory=dict, init=False, repr=False, compare=False)

    def assign_poses(
        self,
        document: Document,
        rows: Int[ndarray, " m"],
        entries: UInt16[ndarray, " m"],
        tracks: Mapping[int, Track],
        touched: Iterable[int],
        size_before: int,
        matrix: Similarity | None = None,
    ) -> None:
        """Point rows at entries, replace tracks by node, and compute the bounds of the `touched` instances again.

        `size_before` is the palette's number of entries before this edit added any. Where bounds can wait, those of
        very many instances stay as they are for now; `matrix` is what moves them, where it is the same for all.
        """
        scene, touched = document.scene, tuple(touched)
        self._rows, self._size_before = rows.astype(np.int32), size_before
        self._table_before = {number: scene.table[number] for number in touched}
        self._tracks_before = {node: scene.actors[node - 1] for node in tracks}
        self._before = document.transforms.assign(self._rows, entries)
        document.replace_tracks(tracks)
        self._deferred_bounds = DeferredBounds(touched, matrix) if len(touched) > MANY else None
        if self._deferred_bounds is None or not document.defer(self, self._deferred_bounds):
            self._deferred_bounds = None
            recount_instances(document, touched)
            document.note_instances_changed(ids_changed=False)

    def undo(self, document: Document) -> None:
        """Point the rows back, drop the entries this edit added, restore tracks and bounds."""
        assert self._rows is not None
        assert self._before is not None
        document.transforms.assign(self._rows, self._before)
        document.transforms.truncate(self._size_before)
        document.replace_tracks(self._tracks_before)
        document.drop_deferred()
        if self._deferred_bounds is None or self._deferred_bounds.begun:
            restore_entries(document, self._table_before)
            document.note_instances_changed(ids_changed=False)
