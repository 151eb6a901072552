"""Many splats, few values: each splat names an entry, and entries are added and removed like a stack."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int, UInt16
from numpy import ndarray

from instdrive_core.scene.per_splat import PerSplatArray, read_only

MAX_ENTRIES = 1 << 16


class PaletteFullError(ValueError):
    """More different entries are alive than a 16-bit palette index can name."""


class EntryPalette(PerSplatArray):
    """Palette indices of N splats and the entries they name; entry 0 is the identity and is never removed.

    Entries are added and removed like a stack, so that undoing an edit restores the palette bit by bit.
    """

    name = "palette"
    """What errors call it."""

    def __init__(self, count: int, identity: Float[ndarray, " w"]) -> None:
        super().__init__(count, np.uint16)
        self._values = identity[None].copy()
        self._keys = [self._values[0].tobytes()]
        self._entry_of = {self._keys[0]: 0}

    @property
    def indices(self) -> UInt16[ndarray, " n"]:
        """The palette entry of each splat, a read-only view."""
        return read_only(self._rows)

    @property
    def values(self) -> Float[ndarray, "p w"]:
        """The numbers of each entry, a read-only view."""
        return read_only(self._values[: len(self._keys)])

    def __len__(self) -> int:
        """The number of entries."""
        return len(self._keys)

    def add_values(self, values: Float[ndarray, " w"]) -> int:
        """The index of an entry with these values: an equal one where there is one, else a new one.

        Raises PaletteFullError where all 65,536 entries are taken.
        """
        values = np.ascontiguousarray(values, self._values.dtype)
        key = values.tobytes()
        if key in self._entry_of:
            return self._entry_of[key]
        index = len(self._keys)
        if index == MAX_ENTRIES:
            raise PaletteFullError(f"the {self.name} holds {MAX_ENTRIES} entries, no other fits")
        if index == len(self._values):
            self._values = np.concatenate([self._values, np.zeros_like(self._values)])
        self._values[index] = values
        self._keys.append(key)
        self._entry_of[key] = index
        self.version += 1
        return index

    def add_changed(
        self, rows: Int[ndarray, " m"], change: Callable[[Float[ndarray, " w"]], Float[ndarray, " w"]]
    ) -> UInt16[ndarray, " m"]:
        """Add `change` of every entry that `rows` name; returns the entry that each row should name instead.

        Raises PaletteFullError, with nothing added, where they do not all fit.
        """
        named, place = np.unique(self._rows[rows], return_inverse=True)
        size = len(self)
        try:
            entries = [self.add_values(change(self._values[entry].copy())) for entry in named.tolist()]
        except PaletteFullError:
            self.truncate(size)
            raise
        return np.array(entries, np.uint16)[place]

    def truncate(self, size: int) -> None:
        """Drop the entries from `size` on; no splat may still name one of them."""
        for key in self._keys[max(size, 1) :]:
            del self._entry_of[key]
            self.version += 1
        del self._keys[max(size, 1) :]

    def assign(self, rows: Int[ndarray, " m"], entries: UInt16[ndarray, " m"]) -> UInt16[ndarray, " m"]:
        """Name an entry for each row; returns the entries named before (the delta an edit stores)."""
        before = self._rows[rows]
        self._write(rows, entries)
        return before
