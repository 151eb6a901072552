"""An index from a value per splat (instance ID, codeword) to the rows that carry it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from jaxtyping import Int32, Int64, UInt32
from numpy import ndarray

from instdrive_core.edits.document.row_kernels import gather_groups, group_rows, number_keys

_FEW_KEYS = 1 << 16
_LARGE_SHARE = 16
"""Where more than one row of so many is asked for, looking at every row is quicker than sorting."""


class RowIndex:
    """Rows grouped by key: built in time proportional to the rows, answers in time proportional to the answer."""

    def __init__(self, keys: UInt32[ndarray, " n"]) -> None:
        if int(keys.max(initial=0)) < max(4 * len(keys), _FEW_KEYS):
            self.keys, self.group_of_row = number_keys(keys)
        else:  # IDs that are far apart
            self.keys, inverse = np.unique(keys, return_inverse=True)
            self.group_of_row = inverse.astype(np.int32)
        self.keys: UInt32[ndarray, " m"]
        """The different keys, rising."""
        self.group_of_row: Int32[ndarray, " n"]
        """Position in `keys` of each row's key."""
        self._order, self._bounds = group_rows(self.group_of_row, len(self.keys))

    @property
    def counts(self) -> Int64[ndarray, " m"]:
        """Rows per key."""
        return np.diff(self._bounds)

    def rows(self, keys: Iterable[int]) -> Int64[ndarray, " k"]:
        """The rows of any of `keys`, rising; keys that no row carries add nothing."""
        groups = self._find_groups(np.unique(np.fromiter(keys, np.uint32)))
        groups = groups[groups >= 0]
        if len(groups) == 1:
            return self._order[self._bounds[groups[0]] : self._bounds[groups[0] + 1]].astype(np.int64)
        if self.counts[groups].sum() * _LARGE_SHARE > len(self.group_of_row):
            wanted = np.zeros(len(self.keys), bool)
            wanted[groups] = True
            return np.flatnonzero(wanted[self.group_of_row])
        rows, _ = gather_groups(self._order, self._bounds, groups)
        return np.sort(rows)

    def parts(self, keys: Sequence[int]) -> tuple[Int64[ndarray, " k"], Int64[ndarray, " p"]]:
        """The rows of one key after another's, rising for each, and the p = keys + 1 places where theirs begin."""
        return gather_groups(self._order, self._bounds, self._find_groups(np.array(keys, np.uint32)))

    def _find_groups(self, keys: UInt32[ndarray, " k"]) -> Int64[ndarray, " k"]:
        """Positions in `self.keys`; -1 for keys that no row carries."""
        if not len(self.keys):
            return np.full(len(keys), -1)
        groups = np.minimum(np.searchsorted(self.keys, keys), len(self.keys) - 1)
        return np.where(self.keys[groups] == keys, groups, -1)
