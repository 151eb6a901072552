"""Cubic cells of space: which of them hang together."""

from __future__ import annotations

import itertools

import numpy as np
from jaxtyping import Int64
from numpy import ndarray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components


def connect_cells(cells: Int64[ndarray, "n 3"]) -> Int64[ndarray, " n"]:
    """Number the component of each of n distinct cells from 0; cells that share a corner are connected."""
    if not len(cells):
        return np.zeros(0, np.int64)
    cells = cells - cells.min(axis=0) + 1
    _, size_y, size_z = cells.max(axis=0) + 2
    keys = (cells[:, 0] * size_y + cells[:, 1]) * size_z + cells[:, 2]
    order = np.argsort(keys)
    keys = keys[order]
    starts, ends = [], []
    offsets = [offset for offset in itertools.product((-1, 0, 1), repeat=3) if offset > (0, 0, 0)]
    for dx, dy, dz in offsets:
        wanted = keys + (dx * size_y + dy) * size_z + dz
        place = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
        found = keys[place] == wanted
        starts.append(np.flatnonzero(found))
        ends.append(place[found])
    start, end = np.concatenate(starts), np.concatenate(ends)
    graph = coo_array((np.ones(len(start), bool), (start, end)), shape=(len(keys), len(keys)))
    _, component = connected_components(graph, directed=False)
    components = np.empty(len(cells), np.int64)
    components[order] = component
    return components
