"""The order in which splats are written where every run of them shares one box: near ones together."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, Int64
from numpy import ndarray

from instdrive_core.maths.morton import compute_morton_codes

BLOCK_ROWS = 8192
WORTH_KEEPING = 1.1
"""An order whose boxes are at most this many times as large as those of the Morton order is kept: a file that was in
good order comes back in the same order, with the same rounding."""


def sort_spatially(means: Float32[ndarray, "n 3"], run: int) -> Int64[ndarray, " n"]:
    """Order rows for boxes around every `run` of them; `means` must be finite. Returns row numbers."""
    count = len(means)
    as_they_are = np.arange(count)
    if count <= run:
        return as_they_are
    by_code = np.argsort(_compute_codes(means), kind="stable")
    if _measure_boxes(means, as_they_are, run) <= WORTH_KEEPING * _measure_boxes(means, by_code, run):
        return as_they_are
    return by_code


def _compute_codes(means: ndarray) -> ndarray:
    low, high = means.min(axis=0), means.max(axis=0)
    codes = np.empty(len(means), np.uint64)
    for start in range(0, len(means), BLOCK_ROWS):
        rows = slice(start, start + BLOCK_ROWS)
        codes[rows] = compute_morton_codes(means[rows], low, high)
    return codes


def _measure_boxes(means: ndarray, order: ndarray, run: int) -> float:
    """Median over the boxes of the sum of their edge lengths, so that a few far splats do not decide."""
    sizes = []
    step = run * max(BLOCK_ROWS // run, 1)
    for start in range(0, len(order), step):
        part = means[order[start : start + step]].astype(np.float64)
        starts = np.arange(0, len(part), run)
        sizes.append((np.maximum.reduceat(part, starts) - np.minimum.reduceat(part, starts)).sum(axis=1))
    return float(np.median(np.concatenate(sizes)))
