"""Seams between copied pieces: gradients are copied instead of colours (Pérez, Gangnet & Blake 2003)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu

HOLD = 0.01
"""Weight of the copied colours beside that of their gradients: a stain at the rim does not colour the whole hole."""
MAX_STEP = 0.08
"""Metres of height from which on two neighbours lie on different sides of a kerb."""


def blend_copies(
    picture: Float64[ndarray, "a b v"],
    known: Bool[ndarray, "a b"],
    hole: Bool[ndarray, "a b"],
    offsets: Int64[ndarray, "a b 2"],
    hold: float = HOLD,
    levels: Float64[ndarray, "a b"] | None = None,
) -> Float64[ndarray, "a b v"]:
    """The picture with copies in its hole, each cell's from `offsets` away, that meet each other and `known` cells
    without a step: screened Poisson equation. Cells that are neither known nor of the hole do not count.

    Where the `levels` (metres) differ that two copies come from there is a kerb: they keep their difference.
    """
    cells, result = np.argwhere(hole), picture.copy()
    count, limit = len(cells), np.array(hole.shape) - 1
    copied = picture[tuple((cells + offsets[hole]).T)]
    if not count:
        return result
    numbers = np.full(hole.shape, -1)
    numbers[hole] = np.arange(count)
    degree, right = np.full(count, hold), hold * copied
    origin = np.zeros(hole.shape) if levels is None else levels
    level = origin.copy()
    level[hole] = origin[tuple((cells + offsets[hole]).T)]
    rows, columns = [], []
    for step in np.array([[0, 1], [0, -1], [1, 0], [-1, 0]]):
        beside = cells + step
        inside = ((beside >= 0) & (beside <= limit)).all(axis=1)
        beside = np.clip(beside, 0, limit)
        is_kerb = np.abs(level[tuple(beside.T)] - level[hole]) > MAX_STEP
        there, filled = known[tuple(beside.T)] & inside & ~is_kerb, hole[tuple(beside.T)] & inside
        other = numbers[tuple(beside.T)]
        mine_at = tuple(np.clip(beside + offsets[hole], 0, limit).T)
        theirs_at = tuple(np.clip(cells + offsets[tuple(beside.T)], 0, limit).T)
        mine, theirs = copied - picture[mine_at], picture[theirs_at] - copied[np.maximum(other, 0)]
        # What lies beside a copy where it comes from tells nothing across a kerb.
        mine_tells = np.abs(origin[mine_at] - level[hole]) <= MAX_STEP
        theirs_tell = filled & (np.abs(origin[theirs_at] - level[tuple(beside.T)]) <= MAX_STEP)
        gradient = np.where(mine_tells[:, None], mine, 0) + np.where(theirs_tell[:, None], theirs, 0)
        gradient /= np.maximum(mine_tells.astype(int) + theirs_tell, 1)[:, None]
        gradient = np.where(is_kerb[:, None], copied - copied[np.maximum(other, 0)], gradient)
        used = there | filled
        degree += used
        right += np.where(used[:, None], gradient, 0)
        right += np.where((there & ~filled)[:, None], picture[tuple(beside.T)], 0)
        rows.append(np.flatnonzero(filled))
        columns.append(other[filled])
    links = np.full(sum(len(each) for each in rows), -1.0)
    diagonal = np.arange(count)
    matrix = coo_array(
        (
            np.concatenate([degree, links]),
            (np.concatenate([diagonal, *rows]), np.concatenate([diagonal, *columns])),
        ),
        shape=(count, count),
    ).tocsc()
    result[hole] = splu(matrix).solve(right)
    return result
