"""Bounds of very many instances that were moved: guessed at once, counted in the frames that follow."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from instdrive_core.edits.document import Document
from instdrive_core.edits.instances import recount
from instdrive_core.instances.table import Instance
from instdrive_core.scene.transforms import Similarity
from instdrive_core.scene.turned import turned_boxes

MANY = 500
"""Instances; of fewer the bounds are counted sooner than a frame is over."""


class LateBounds:
    """The instances that are not counted so far; to be called until it returns that all are."""

    def __init__(self, document: Document, ids: Sequence[int]) -> None:
        self._document, self._ids, self._done = document, tuple(ids), 0

    def __call__(self, rows: int | None) -> bool:
        """Count instances of about so many rows, None = all; returns whether none is left."""
        ids, table = self._ids[self._done :], self._document.scene.table
        if rows is not None:
            sizes = np.cumsum([table[instance_id].count for instance_id in ids])
            ids = ids[: int(np.searchsorted(sizes, rows)) + 1]
        recount(self._document, ids)
        self._done += len(ids)
        if self._done < len(self._ids):
            return False
        self._document.instances_changed(ids_changed=False)
        return True


def guess_bounds(document: Document, ids: Sequence[int], matrix: Similarity | None) -> None:
    """Move instances' bounds by [s R | t], in their boxes' frames by s; without a matrix they stay."""
    if matrix is None:
        return
    table = document.scene.table
    entries = [table[instance_id] for instance_id in ids]
    still = [entry for entry in entries if not entry.node]
    boxes = turned_boxes(np.array([entry.bounds for entry in still], np.float64).reshape(-1, 2, 3), matrix).tolist()
    for entry, (low, high) in zip(still, boxes, strict=True):
        bounds = ((low[0], low[1], low[2]), (high[0], high[1], high[2]))
        table.set(Instance(entry.id, entry.name, 0, entry.codeword, entry.count, entry.class_name, bounds))
    recount(document, [entry.id for entry in entries if entry.node])
