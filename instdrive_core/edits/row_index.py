"""From a value per splat (instance ID, codeword) to the rows that carry it."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from jaxtyping import Int32, Int64, UInt32
from numpy import ndarray


class RowIndex:
    """Rows grouped by key: built in one sort, answers in time proportional to the answer."""

    def __init__(self, keys: UInt32[ndarray, " n"]) -> None:
        # One sort of (key, row) packed into 64 bits beats a stable argsort by several times at a million rows.
        packed = np.sort((keys.astype(np.uint64) << np.uint64(32)) | np.arange(len(keys), dtype=np.uint64))
        self._order = (packed & np.uint64(0xFFFFFFFF)).astype(np.int32)
        ordered = (packed >> np.uint64(32)).astype(np.uint32)
        first = np.flatnonzero(np.diff(ordered, prepend=ordered[:1] - np.uint32(1))) if len(keys) else np.zeros(0, int)
        self.keys: UInt32[ndarray, " m"] = ordered[first]
        """The different keys, rising."""
        self._bounds = np.append(first, len(keys))
        self.group_of_row: Int32[ndarray, " n"] = np.empty(len(keys), np.int32)
        """Position in `keys` of each row's key."""
        self.group_of_row[self._order] = np.repeat(np.arange(len(first), dtype=np.int32), self.counts)

    @property
    def counts(self) -> Int64[ndarray, " m"]:
        """Rows per key."""
        return np.diff(self._bounds)

    def rows(self, keys: Iterable[int]) -> Int64[ndarray, " k"]:
        """The rows of any of `keys`, rising; keys that no row carries add nothing."""
        wanted = np.unique(np.fromiter(keys, np.uint32))
        groups = np.searchsorted(self.keys, wanted)
        parts = [
            self._order[self._bounds[group] : self._bounds[group + 1]]
            for group, key in zip(groups.tolist(), wanted.tolist(), strict=True)
            if group < len(self.keys) and self.keys[group] == key
        ]
        if not parts:
            return np.zeros(0, np.int64)
        rows = np.concatenate(parts).astype(np.int64)
        return np.sort(rows) if len(parts) > 1 else rows
