"""Rows by the group that they are in."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int64, Integer
from numpy import ndarray


def split_by_group(
    groups: Integer[ndarray, " n"], rows: Int64[ndarray, " k"] | None = None
) -> list[tuple[int, Int64[ndarray, " _"]]]:
    """Split rows, by default all, by the group of each; groups rise, and the rows of each keep their order."""
    rows = np.arange(len(groups)) if rows is None else rows
    ordered = rows[np.argsort(groups[rows], kind="stable")]
    numbers, starts = np.unique(groups[ordered], return_index=True)
    return list(zip(numbers.tolist(), np.split(ordered, starts)[1:], strict=True))
