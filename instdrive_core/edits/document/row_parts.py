"""The rows of many instances at once, one instance's after another's."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Int64
from numpy import ndarray


@dataclass(frozen=True, eq=False)
class RowParts:
    """Rows in parts: part k is ``rows[bounds[k] : bounds[k + 1]]``."""

    rows: Int64[ndarray, " m"]
    bounds: Int64[ndarray, " p"]
    """One more than there are parts, from 0 to m."""

    @classmethod
    def whole(cls, rows: Int64[ndarray, " m"]) -> RowParts:
        """All rows as one part."""
        return cls(rows, np.array([0, len(rows)]))

    def __len__(self) -> int:
        """Number of parts."""
        return len(self.bounds) - 1

    def __iter__(self) -> Iterator[Int64[ndarray, " k"]]:
        return (self.rows[first:last] for first, last in zip(self.bounds[:-1], self.bounds[1:], strict=True))

    @property
    def sizes(self) -> Int64[ndarray, " p"]:
        """Rows of each part."""
        return np.diff(self.bounds)

    def filter(self, kept: Bool[ndarray, " m"]) -> RowParts:
        """The parts with only some of their rows; a part may be left empty."""
        if kept.all():
            return self
        before = np.concatenate([[0], np.cumsum(kept)])
        return RowParts(self.rows[kept], before[self.bounds])

    def drop_empty(self) -> RowParts:
        """The parts that have any row."""
        return RowParts(self.rows, np.append(self.bounds[:-1][self.sizes > 0], self.bounds[-1]))
