"""Facades as wholes: windows, cornices and what stands before them cut a wall in pieces that hang together in plan."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, Int32, UInt32
from numpy import ndarray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from instdrive_core.masks.lidar.cluster_kind import FACADE
from instdrive_core.masks.lidar.clusters import thin_rows

CELL = 0.25
"""Metres along an edge of the cells that stand for a piece in plan."""
GAP, GAP_PER_METRE, MAX_GAP = 1.0, 0.02, 2.5
"""Metres along the ground between pieces of one facade: at least, per metre of distance from the sensor, at most."""


def join_facades(
    points: Float32[ndarray, "n 3"],
    clusters: Int32[ndarray, " n"],
    kinds: UInt32[ndarray, " c"],
    distance: Float32[ndarray, " n"],
) -> Int32[ndarray, " n"]:
    """Join pieces of facades that lie close to each other in plan, whatever their heights.

    A piece takes the number of the lowest one that it hangs together with.

    Args:
        points: metres.
        clusters: number by point.
        kinds: kind by number (`cluster_kind`).
        distance: metres from the sensor's path.
    """
    rows = np.flatnonzero(kinds[clusters] == FACADE)
    if not len(rows):
        return clusters
    flat = np.column_stack([points[rows, :2], CELL * clusters[rows]]).astype(np.float32)  # one level for each piece
    cells = rows[thin_rows(flat, CELL)]
    pairs = KDTree(points[cells, :2]).query_pairs(MAX_GAP, output_type="ndarray")
    one, other = cells[pairs[:, 0]], cells[pairs[:, 1]]
    gap = np.linalg.norm(points[one, :2] - points[other, :2], axis=1)
    near = gap < np.clip(GAP_PER_METRE * np.minimum(distance[one], distance[other]), GAP, MAX_GAP)
    near &= clusters[one] != clusters[other]
    touching = np.unique(np.column_stack([clusters[one[near]], clusters[other[near]]]), axis=0)
    graph = coo_matrix((np.ones(len(touching), bool), (touching[:, 0], touching[:, 1])), shape=(len(kinds),) * 2)
    _, whole = connected_components(graph, directed=False)
    lowest = np.full(int(whole.max()) + 1, len(kinds))
    np.minimum.at(lowest, whole, np.arange(len(kinds)))
    return lowest[whole][clusters].astype(np.int32)
