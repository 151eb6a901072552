"""Euclidean clustering of points, whose reach grows with the distance from the sensor."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, Int32, Int64
from numpy import ndarray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

NEIGHBOURS = 12
SMALL = 12
"""Points of a cluster that may be a splinter of a larger one."""


def cluster_points(
    points: Float32[ndarray, "n 3"], reach: Float32[ndarray, " n"], groups: Int64[ndarray, " n"] | None = None
) -> Int32[ndarray, " n"]:
    """Number the cluster of each point from 0: a point hangs together with those of its nearest neighbours that lie
    within the smaller one of their reaches. Only few neighbours are looked at: dense surfaces keep narrower gaps.

    Args:
        points: metres.
        reach: by point, metres.
        groups: points of different groups never hang together; None = all are one group.
    """
    if not len(points):
        return np.zeros(0, np.int32)
    count = min(NEIGHBOURS, len(points))
    distances, neighbours = KDTree(points).query(points, count, distance_upper_bound=float(reach.max()))
    first, column = np.nonzero(np.isfinite(np.reshape(distances, (len(points), count))))
    second = np.reshape(neighbours, (len(points), count))[first, column]
    linked = np.reshape(distances, (len(points), count))[first, column] < np.minimum(reach[first], reach[second])
    if groups is not None:
        linked &= groups[first] == groups[second]
    ones = np.ones(int(linked.sum()), bool)
    graph = coo_matrix((ones, (first[linked], second[linked])), shape=(len(points), len(points)))
    return connected_components(graph, directed=False)[1].astype(np.int32)


def thin_rows(points: Float32[ndarray, "n 3"], cell: float) -> Int64[ndarray, " m"]:
    """Choose rows of one point per cubic cell of `cell` metres, in order."""
    if not len(points):
        return np.zeros(0, np.int64)
    cells = np.floor(points / cell).astype(np.int64)
    cells -= cells.min(axis=0)
    _, sizes_y, sizes_z = (cells.max(axis=0) + 1).tolist()
    _, rows = np.unique((cells[:, 0] * sizes_y + cells[:, 1]) * sizes_z + cells[:, 2], return_index=True)
    return np.sort(rows)


def absorb_small_clusters(
    points: Float32[ndarray, "n 3"], clusters: Int32[ndarray, " n"], reach: Float32[ndarray, " n"]
) -> Int32[ndarray, " n"]:
    """Renumber clusters with small ones joined to the larger one nearest to them within twice their reach."""
    if not len(points):
        return clusters
    small = np.bincount(clusters)[clusters] < SMALL
    if small.all() or not small.any():
        return np.unique(clusters, return_inverse=True)[1].astype(np.int32)
    distances, nearest = KDTree(points[~small]).query(points[small], distance_upper_bound=2 * float(reach.max()))
    rows = np.flatnonzero(small)
    near = distances < 2 * reach[rows]
    joined = clusters.copy()
    joined[rows[near]] = clusters[~small][np.asarray(nearest)[near]]
    return np.unique(joined, return_inverse=True)[1].astype(np.int32)
