"""Taking moves back, whatever was done between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from instdrive_core.edits.bases.editable import check_unlocked, find_editable_rows
from instdrive_core.edits.bases.parameters import check_ids
from instdrive_core.edits.bases.poses import PoseEdit
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import describe_ids
from instdrive_core.edits.document.entries import add_changed_entries
from instdrive_core.edits.document.row_parts import RowParts
from instdrive_core.scene.transforms import reset_entry
from instdrive_core.wording import phrase


@dataclass
class ResetMoves(PoseEdit):
    """Put instances back to where the scene's file has them, in their trained size; of a moving actor its whole track.

    Where the whole scene was turned since, that is where the turn has put them. A copy goes back to where its original
    was trained.
    """

    kind: ClassVar[str] = "reset_moves"
    ids: tuple[int, ...]

    def __post_init__(self) -> None:
        self.ids = check_ids(self.ids)

    @property
    def title(self) -> str:
        """``Reset the move of instance 17``."""
        return phrase("Reset the move of {objects}", objects=describe_ids(self.ids))

    def do(self, document: Document) -> bool:
        """Name the homes again, and give actors their first tracks."""
        scene, rows = document.scene, find_editable_rows(document, self.ids)
        nodes = sorted(set(scene.nodes[rows].tolist()) - {0})
        sharing = [entry.id for entry in scene.table if entry.node in nodes]
        check_unlocked(document, sharing)
        if nodes:  # an actor's instances were moved together
            rows = np.union1d(rows, np.flatnonzero(np.isin(scene.nodes, nodes)))
        palette = document.transforms
        is_away = (palette.matrices != palette.homes).any(axis=(1, 2))
        rows = rows[is_away[palette.indices[rows]]]
        first = {node: document.get_first_track(node) for node in nodes}
        moved = {node: track for node, track in first.items() if track is not scene.actors[node - 1]}
        if not len(rows) and not moved:
            return False
        named = set(self.ids)
        touched = [entry.id for entry in scene.table if entry.node in nodes or entry.id in named]
        size_before = len(palette)
        entries = add_changed_entries(palette, [(RowParts.whole(rows), reset_entry)])
        self.assign_poses(document, rows, entries, moved, touched, size_before)
        return True
