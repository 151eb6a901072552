"""An array of one number per splat that edits write and readers follow; rows are added and removed at its end."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int, Shaped
from numpy import ndarray

from instdrive_core.scene.dirty_rows import DirtyReader, DirtyRows
from instdrive_core.scene.row_writes import exchange_values


class PerSplatArray:
    """Base of the arrays of edit state; subclasses say what their numbers mean, and when to write them."""

    def __init__(self, count: int, dtype: type[np.unsignedinteger]) -> None:
        self._rows = np.zeros(count, dtype)
        self._dirty = DirtyRows(count)
        self.version = 0
        """Rises with every change."""

    def append(self, count: int) -> None:
        """Add `count` splats, at 0."""
        start = len(self._rows)
        self._rows = np.concatenate([self._rows, np.zeros(count, self._rows.dtype)])
        self._touch(start, start + count)

    def drop_rows(self, count: int) -> None:
        """Take the last `count` splats away again."""
        self._rows = self._rows[: len(self._rows) - count].copy()
        self._dirty.shorten(len(self._rows))
        self.version += 1

    def create_dirty_reader(self) -> DirtyReader:
        """Create a reader that follows changes; to it all rows are new."""
        return self._dirty.create_reader()

    def _exchange(self, rows: Int[ndarray, " m"], values: Shaped[ndarray, " m"]) -> Shaped[ndarray, " m"]:
        before, low, high = exchange_values(self._rows, rows, np.asarray(values, self._rows.dtype))
        if len(rows):
            self._touch(int(low), int(high))
        return before

    def _touch(self, start: int, stop: int) -> None:
        self.version += 1
        self._dirty.touch(start, stop)


def create_read_only_view(array: ndarray) -> ndarray:
    """Create a view that cannot be written."""
    view = array.view()
    view.flags.writeable = False
    return view
