"""Which rows of a document come from which rows of another one, as both grow by the same edits."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, Int64
from numpy import ndarray
from scipy.spatial import KDTree


class RowOrigins:
    """Pairs of rows of an old and of a new document: one that was, and what came of it.

    Args:
        parents: the old row of each new one.
        old_rows: number of rows of the old document.
    """

    def __init__(self, parents: Int64[ndarray, " m"], old_rows: int) -> None:
        self._old, self._new = parents.astype(np.int64), np.arange(len(parents))
        self._old_rows, self._new_rows = old_rows, len(parents)

    def spread(self, rows: Int64[ndarray, " k"]) -> Int64[ndarray, " l"]:
        """Find all new rows, rising, that come from any of these old ones."""
        chosen = np.zeros(self._old_rows, bool)
        chosen[rows] = True
        return np.unique(self._new[chosen[self._old]])

    def append(self, old_means: Float32[ndarray, "k 3"], new_means: Float32[ndarray, "l 3"]) -> None:
        """Follow an edit that added rows to both: as many are the same ones; else the nearest belong together, each
        with at least one."""
        old, new = np.arange(len(old_means)), np.arange(len(new_means))
        if len(old) and len(new) and len(old) != len(new):
            old_means, new_means = np.nan_to_num(old_means), np.nan_to_num(new_means)
            to_old, to_new = KDTree(old_means).query(new_means)[1], KDTree(new_means).query(old_means)[1]
            old, new = np.concatenate([to_old, old]), np.concatenate([new, to_new])
        count = min(len(old), len(new))
        self._old = np.concatenate([self._old, self._old_rows + old[:count]])
        self._new = np.concatenate([self._new, self._new_rows + new[:count]])
        self._old_rows += len(old_means)
        self._new_rows += len(new_means)
