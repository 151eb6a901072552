"""An array of one number per splat that edits write and readers follow; rows are added and removed at its end."""

from __future__ import annotations

from copy import copy
from typing import TypeVar

import numpy as np
from jaxtyping import Int, Shaped
from numpy import ndarray

from instdrive_core.scene.dirty_rows import DirtyReader, DirtyRows
from instdrive_core.scene.row_writes import exchange_values

_Array = TypeVar("_Array", bound="PerSplatArray")


class PerSplatArray:
    """Base of the arrays of edit state; subclasses say what their numbers mean, and when to write them.

    Who only reads shares the memory: `share_rows` and `fork` cost nothing, and the first change after them is written
    to a copy.
    """

    def __init__(self, count: int, dtype: type[np.unsignedinteger]) -> None:
        self._rows, self._is_shared = np.zeros(count, dtype), False
        self._dirty = DirtyRows(count)
        self.version = 0
        """Rises with every change."""

    def share_rows(self) -> Shaped[ndarray, " n"]:
        """Share the numbers as they are now, whatever changes later. Nobody may write to them."""
        self._is_shared = True
        return self._rows

    def fork(self: _Array) -> _Array:
        """Make another of these arrays that begins with the same numbers; to its readers all rows are new."""
        other = copy(self)
        other._dirty = DirtyRows(len(self._rows))
        self._is_shared = other._is_shared = True
        return other

    def append(self, count: int) -> None:
        """Add `count` splats, at 0."""
        start = len(self._rows)
        self._rows, self._is_shared = np.concatenate([self._rows, np.zeros(count, self._rows.dtype)]), False
        self._touch(start, start + count)

    def drop_rows(self, count: int) -> None:
        """Take the last `count` splats away again."""
        self._rows, self._is_shared = self._rows[: len(self._rows) - count].copy(), False
        self._dirty.shorten(len(self._rows))
        self.version += 1

    def create_dirty_reader(self) -> DirtyReader:
        """Create a reader that follows changes; to it all rows are new."""
        return self._dirty.create_reader()

    def _exchange(self, rows: Int[ndarray, " m"], values: Shaped[ndarray, " m"]) -> Shaped[ndarray, " m"]:
        before, low, high = exchange_values(self._own_rows(rows), rows, np.asarray(values, self._rows.dtype))
        if len(rows):
            self._touch(int(low), int(high))
        return before

    def _own_rows(self, changed: Int[ndarray, " m"]) -> Shaped[ndarray, " n"]:
        """The numbers, where some may be changed: nobody else's from now on, unless none is."""
        if self._is_shared and len(changed):
            self._rows, self._is_shared = self._rows.copy(), False
        return self._rows

    def _touch(self, start: int, stop: int) -> None:
        self.version += 1
        self._dirty.touch(start, stop)


def create_read_only_view(array: ndarray) -> ndarray:
    """Create a view that cannot be written."""
    view = array.view()
    view.flags.writeable = False
    return view
