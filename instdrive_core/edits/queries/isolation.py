"""Points that lie by themselves, by the distances to their neighbours."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray
from scipy.spatial import KDTree

_NEIGHBORS = 6


def find_isolated(points: Float[ndarray, "n 3"], times: float, workers: int = 1) -> Bool[ndarray, " n"]:
    """Find points whose sixth neighbour is more than so many times as far away as the median of all.

    Points that are not finite count neither as isolated nor as neighbours, and of six points none is isolated.
    """
    rows, isolated = np.flatnonzero(np.isfinite(points).all(axis=1)), np.zeros(len(points), np.bool_)
    if len(rows) > _NEIGHBORS:
        tree = KDTree(points[rows], balanced_tree=False)
        distances = tree.query(points[rows], k=_NEIGHBORS + 1, workers=workers)[0][:, -1]
        isolated[rows] = distances > times * np.median(distances)
    return isolated
