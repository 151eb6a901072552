"""A set of rows as runs of neighbours: compact in memory and in files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int, Int64
from numpy import ndarray

from instdrive_core.errors import EditError


@dataclass(frozen=True, eq=False)
class RowRuns:
    """Rows ``starts[k] … starts[k] + lengths[k] - 1`` of all k: rising, neither touching nor empty."""

    starts: Int64[ndarray, " r"]
    lengths: Int64[ndarray, " r"]

    @classmethod
    def from_rows(cls, rows: Int[ndarray, " m"]) -> RowRuns:
        """The runs of some rows, in any order. Raises EditError where one is below 0."""
        ordered = rows.astype(np.int64)
        if len(ordered) and not (np.diff(ordered) > 0).all():
            ordered = np.unique(ordered)
        if len(ordered) and ordered[0] < 0:
            raise EditError(f"row {ordered[0]} is below 0")
        first = np.flatnonzero(np.diff(ordered, prepend=-2) != 1)
        return cls(ordered[first], np.diff(first, append=len(ordered)))

    @classmethod
    def from_json(cls, pairs: Sequence[object]) -> RowRuns:
        """The inverse of `to_json`. Raises EditError where `pairs` is something else."""
        whole = [
            pair
            for pair in pairs
            if isinstance(pair, list | tuple) and len(pair) == 2 and all(type(number) is int for number in pair)
        ]
        if len(whole) != len(pairs):
            raise EditError("rows are no list of pairs [first row, number of rows]")
        try:
            starts, lengths = np.array(whole, np.int64).reshape(-1, 2).T
        except OverflowError as error:
            raise EditError("rows hold a number of more than 63 bits") from error
        gaps = starts[1:] - starts[:-1] - lengths[:-1]
        if (starts < 0).any() or (lengths < 1).any() or (gaps < 1).any():
            raise EditError("rows are no rising runs with gaps between them, each of at least one row from 0 on")
        return cls(starts.copy(), lengths.copy())

    def to_json(self) -> list[list[int]]:
        """Pairs of first row and number of rows."""
        return np.stack([self.starts, self.lengths], axis=1).tolist()

    def __len__(self) -> int:
        """Number of rows."""
        return int(self.lengths.sum())

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, RowRuns):
            return NotImplemented
        return np.array_equal(self.starts, other.starts) and np.array_equal(self.lengths, other.lengths)

    __hash__ = None  # type: ignore[assignment]

    @property
    def end(self) -> int:
        """One more than the last row; 0 for no rows."""
        return int(self.starts[-1] + self.lengths[-1]) if len(self.starts) else 0

    @property
    def rows(self) -> Int64[ndarray, " m"]:
        """All rows, rising."""
        before = np.cumsum(self.lengths) - self.lengths
        return np.arange(len(self)) + np.repeat(self.starts - before, self.lengths)


def expand_runs(runs: RowRuns, count: int) -> Int64[ndarray, " m"]:
    """All rows, rising. Raises EditError for those that a scene of `count` splats does not have."""
    if runs.end > count:
        raise EditError(f"row {runs.end - 1} is beyond the scene's {count:,} splats")
    return runs.rows


def make_runs(rows: RowRuns | Int[ndarray, " m"] | Sequence[object]) -> RowRuns:
    """Rows given in any of the ways that edits take them: runs, their JSON, or an array of row numbers.

    Raises EditError where they are something else.
    """
    if isinstance(rows, RowRuns):
        return rows
    if isinstance(rows, ndarray):
        if rows.ndim != 1 or rows.dtype.kind not in "iu":
            raise EditError(f"rows are a {rows.dtype} array of shape {rows.shape}, not a list of numbers")
        return RowRuns.from_rows(rows)
    if not isinstance(rows, tuple | list):
        raise EditError(f"rows are {rows!r}, no list of pairs [first row, number of rows]")
    return RowRuns.from_json(rows)
