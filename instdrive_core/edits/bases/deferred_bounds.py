"""Bounds of very many moved instances: computed in the frames after the move, so that the move itself is quick."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.edits.bases.relabel import recount_instances
from instdrive_core.edits.document.document import DeferredWork, Document
from instdrive_core.scene.pose_transforms import transform_boxes
from instdrive_core.scene.transforms import Similarity

MANY = 500
"""Number of instances from which on bounds are deferred: those of fewer take less than a frame."""


class DeferredBounds(DeferredWork):
    """Instances whose bounds in the table are still those from before a move."""

    def __init__(self, ids: Sequence[int], matrix: Similarity | None) -> None:
        """`matrix` = [s R | t] moved all of them that do not drive; None = each moved in its own way."""
        self._ids, self._matrix, self._done = tuple(ids), matrix, 0

    @property
    def begun(self) -> bool:
        """Whether the bounds of any instance are computed already."""
        return self._done > 0

    def do(self, document: Document, rows: int | None) -> bool:
        """Compute the bounds of instances with about so many rows, None = all; returns whether none is left."""
        ids, table = self._ids[self._done :], document.scene.table
        if rows is not None:
            sizes = np.cumsum([table[instance_id].count for instance_id in ids])
            ids = ids[: int(np.searchsorted(sizes, rows)) + 1]
        recount_instances(document, ids)
        self._done += len(ids)
        if self._done < len(self._ids):
            return False
        document.note_instances_changed(ids_changed=False)
        return True

    def move_box(self, box: Float64[ndarray, "2 3"], ids: Sequence[int]) -> Float64[ndarray, "2 3"]:
        """Roughly where a move took a box around instances; the table still has their bounds from before it."""
        if self._matrix is None or not set(ids) <= set(self._ids):
            return box
        return transform_boxes(box[None], self._matrix)[0]
