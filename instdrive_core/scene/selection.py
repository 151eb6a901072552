"""Edit state: one byte per splat, with one writer that tracks what must be uploaded again."""

from __future__ import annotations

from enum import IntFlag

import numpy as np
from jaxtyping import Bool, Int, UInt8
from numpy import ndarray

from instdrive_core.scene.dirty_rows import DirtyReader, DirtyRows


class Flag(IntFlag):
    """Bits of a splat's state."""

    SELECTED = 1
    HIDDEN = 2
    LOCKED = 4
    DELETED = 8


class SplatState:
    """The state bytes of N splats. Arrays grow by appending only; deletion is a flag, dropped at export."""

    def __init__(self, count: int) -> None:
        self._flags = np.zeros(count, np.uint8)
        self._dirty = DirtyRows(count)
        self.version = 0
        """Rises with every change."""

    def __len__(self) -> int:
        return len(self._flags)

    @property
    def flags(self) -> UInt8[ndarray, " n"]:
        """A read-only view."""
        view = self._flags.view()
        view.flags.writeable = False
        return view

    def rows_with(self, flag: Flag) -> Int[ndarray, " m"]:
        """Rows that have any of the bits of `flag`."""
        return np.flatnonzero(self._flags & np.uint8(flag))

    def mask(self, flag: Flag) -> Bool[ndarray, " n"]:
        """Whether each row has any of the bits of `flag`."""
        return (self._flags & np.uint8(flag)) != 0

    @property
    def drawn(self) -> Bool[ndarray, " n"]:
        """Rows that are neither hidden nor deleted."""
        return (self._flags & np.uint8(Flag.HIDDEN | Flag.DELETED)) == 0

    def change(self, rows: Int[ndarray, " m"], flag: Flag, on: bool) -> Int[ndarray, " k"]:
        """Set or clear a bit; returns the rows that really changed (the delta an edit stores)."""
        bit = np.uint8(flag)
        before = (self._flags[rows] & bit) == bit
        changed = np.asarray(rows)[before != on]
        if len(changed):
            if on:
                self._flags[changed] |= bit
            else:
                self._flags[changed] &= ~bit
            self._touch(int(changed.min()), int(changed.max()) + 1)
        return changed

    def append(self, count: int) -> None:
        """Add `count` splats with no bit set."""
        start = len(self._flags)
        self._flags = np.concatenate([self._flags, np.zeros(count, np.uint8)])
        self._touch(start, start + count)

    def drop_rows(self, count: int) -> None:
        """Take the last `count` splats away again."""
        self._flags = self._flags[: len(self._flags) - count].copy()
        self._dirty.shorten(len(self._flags))
        self.version += 1

    def take_dirty(self) -> tuple[int, int] | None:
        """The row range changed since the last call, or None."""
        return self._dirty.take()

    def dirty_reader(self) -> DirtyReader:
        """Follows changes for one more reader, independent of `take_dirty`; to it all rows are new."""
        return self._dirty.reader()

    def _touch(self, start: int, stop: int) -> None:
        self.version += 1
        self._dirty.touch(start, stop)
