"""Many splats, few values: each splat names an entry, and entries are added and removed like a stack."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np
from jaxtyping import Float, Int, Int64, UInt16
from numpy import ndarray

from instdrive_core.scene.named_entries import find_named_entries
from instdrive_core.scene.splat_array import PerSplatArray, create_read_only_view

MAX_ENTRIES = 1 << 16

_Palette = TypeVar("_Palette", bound="EntryPalette")


class PaletteFullError(ValueError):
    """More different entries are alive than a 16-bit palette index can name."""


class EntryPalette(PerSplatArray):
    """Palette indices of N splats and the entries they name; entry 0 is the identity and is never removed.

    Entries are added and removed like a stack, so that undoing an edit restores the palette bit by bit.
    """

    name = "palette"
    """Name in error messages."""

    def __init__(self, count: int, identity: Float[ndarray, " w"]) -> None:
        super().__init__(count, np.uint16)
        self._values = identity[None].copy()
        self._keys = [self._values[0].tobytes()]
        self._entry_of = {self._keys[0]: 0}

    def fork(self: _Palette) -> _Palette:
        """Make another palette that begins with the same entries and splats; to its readers all rows are new."""
        other = super().fork()
        other._values, other._keys, other._entry_of = self._values.copy(), self._keys.copy(), self._entry_of.copy()
        return other

    @property
    def indices(self) -> UInt16[ndarray, " n"]:
        """The palette entry of each splat, a read-only view."""
        return create_read_only_view(self._rows)

    @property
    def values(self) -> Float[ndarray, "p w"]:
        """The numbers of each entry, a read-only view."""
        return create_read_only_view(self._values[: len(self._keys)])

    def __len__(self) -> int:
        """The number of entries."""
        return len(self._keys)

    def add_values(self, values: Float[ndarray, " w"]) -> int:
        """Find the index of an entry with these values; adds a new entry where none is equal.

        Raises PaletteFullError where all 65,536 entries are taken.
        """
        return self.add_all(values[None])[0]

    def add_all(self, values: Float[ndarray, "k w"]) -> list[int]:
        """Find or add entries, one after another. Raises PaletteFullError, with nothing added, if they do not fit."""
        values = np.ascontiguousarray(values, self._values.dtype)
        data, width, size = values.tobytes(), values.itemsize * values.shape[1], len(self._keys)
        found, fresh = [], []
        for row in range(len(values)):
            key = data[row * width : (row + 1) * width]
            index = self._entry_of.get(key)
            if index is None:
                index = len(self._keys)
                if index == MAX_ENTRIES:
                    self._forget(size)
                    raise PaletteFullError(f"the {self.name} holds {MAX_ENTRIES} entries, no other fits")
                self._keys.append(key)
                self._entry_of[key] = index
                fresh.append(row)
            found.append(index)
        if fresh:
            if len(self._keys) > len(self._values):
                spare = np.zeros((max(2 * len(self._values), len(self._keys)) - size, self._values.shape[1]))
                self._values = np.concatenate([self._values[:size], spare.astype(self._values.dtype)])
            self._values[size : len(self._keys)] = values[fresh]
            self.version += 1
        return found

    def add_changes(
        self,
        rows: Int[ndarray, " m"],
        bounds: Int64[ndarray, " p"],
        change: Callable[[Float[ndarray, "k w"], Int64[ndarray, " k"]], Float[ndarray, "k w"]],
    ) -> UInt16[ndarray, " m"]:
        """Add `change` of every entry that `rows` name, one part of the rows after another, each in its own way.

        Args:
            rows: of all parts.
            bounds: where each part begins, and the number of rows.
            change: of the values of k entries, each named by the part whose number it gets.

        Returns the entry that each row should name instead. Raises PaletteFullError, with nothing added, where they do
        not all fit.
        """
        named = find_named_entries(self._rows, np.asarray(rows, np.int64), bounds, len(self))
        if not len(named.entries):
            return np.zeros(0, np.uint16)
        return np.array(self.add_all(change(self._values[named.entries], named.parts)), np.uint16)[named.place]

    def truncate(self, size: int) -> None:
        """Drop the entries from `size` on; no splat may still name one of them."""
        if max(size, 1) < len(self._keys):
            self._forget(max(size, 1))
            self.version += 1

    def _forget(self, size: int) -> None:
        for key in self._keys[size:]:
            del self._entry_of[key]
        del self._keys[size:]

    def assign(self, rows: Int[ndarray, " m"], entries: UInt16[ndarray, " m"]) -> UInt16[ndarray, " m"]:
        """Name an entry for each row; returns the entries named before (the delta an edit stores)."""
        return self._exchange(np.asarray(rows), entries)
