"""Edit state: one byte per splat, with one writer that tracks what must be uploaded again."""

from __future__ import annotations

from enum import IntFlag

import numpy as np
from jaxtyping import Bool, Int, UInt8
from numpy import ndarray

from instdrive_core.scene.row_writes import change_bits
from instdrive_core.scene.splat_array import PerSplatArray, create_read_only_view


class Flag(IntFlag):
    """Bits of a splat's state."""

    SELECTED = 1
    HIDDEN = 2
    LOCKED = 4
    DELETED = 8


class SplatState(PerSplatArray):
    """The state bytes of N splats. Arrays grow by appending only; deletion is a flag, dropped at export."""

    def __init__(self, count: int) -> None:
        super().__init__(count, np.uint8)

    def __len__(self) -> int:
        return len(self._rows)

    @property
    def flags(self) -> UInt8[ndarray, " n"]:
        """State byte of each splat, a read-only view."""
        return create_read_only_view(self._rows)

    def find_rows(self, flag: Flag) -> Int[ndarray, " m"]:
        """Find the rows that have any of the bits of `flag`."""
        return np.flatnonzero(self._rows & np.uint8(flag))

    def find_mask(self, flag: Flag) -> Bool[ndarray, " n"]:
        """Find for each row whether it has any of the bits of `flag`."""
        return (self._rows & np.uint8(flag)) != 0

    @property
    def drawn(self) -> Bool[ndarray, " n"]:
        """Rows that are neither hidden nor deleted."""
        return (self._rows & np.uint8(Flag.HIDDEN | Flag.DELETED)) == 0

    def change(self, rows: Int[ndarray, " m"], flag: Flag, on: bool) -> Int[ndarray, " k"]:
        """Set or clear a bit; returns the rows that really changed (the delta an edit stores)."""
        changed, low, high = change_bits(self._own_rows(rows), np.asarray(rows, np.int64), np.uint8(flag), on)
        if len(changed):
            self._touch(int(low), int(high))
        return changed
