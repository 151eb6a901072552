"""Values of a gap that are as smooth as those around it allow."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float64
from numpy import ndarray
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve


def continue_smoothly(
    values: Float64[ndarray, "a b"], known: Bool[ndarray, "a b"], gap: Bool[ndarray, "a b"]
) -> Float64[ndarray, "a b"]:
    """Values of the gap that are the mean of their neighbours (Laplace's equation), free where nothing is known.

    Pieces of the gap that touch nothing known get 0; cells outside of the gap keep their values.
    """
    numbers = np.full(gap.shape, -1)
    numbers[gap] = np.arange(np.count_nonzero(gap))
    parts = np.zeros(gap.shape, np.int32)
    ndimage.label(gap, output=parts)
    touched = np.unique(parts[gap & np.asarray(ndimage.binary_dilation(known), bool)])
    free = gap & ~np.isin(parts, touched)
    count = int(gap.sum())
    degree, right = np.zeros(count), np.zeros(count)
    rows, columns = [], []
    for axis in (0, 1):
        for step in (-1, 1):
            neighbor = np.roll(numbers, -step, axis)
            there = np.ones(gap.shape, bool)
            edge = [slice(None), slice(None)]
            edge[axis] = slice(-1, None) if step == 1 else slice(0, 1)
            there[tuple(edge)] = False
            inside = gap & there & (neighbor >= 0)
            beside = gap & there & np.roll(known, -step, axis)
            rows.append(numbers[inside])
            columns.append(neighbor[inside])
            degree[numbers[inside]] += 1
            degree[numbers[beside]] += 1
            right[numbers[beside]] += np.roll(values, -step, axis)[beside]
    degree[numbers[free]] += 1
    diagonal = np.arange(count)
    matrix = coo_array(
        (
            np.concatenate([degree, np.full(sum(len(each) for each in rows), -1.0)]),
            (np.concatenate([diagonal, *rows]), np.concatenate([diagonal, *columns])),
        ),
        shape=(count, count),
    ).tocsc()
    result = values.copy()
    result[gap] = spsolve(matrix, right)
    return result
