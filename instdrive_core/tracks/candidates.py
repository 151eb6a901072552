"""Clusters of one sweep's points that are not confirmed to stand still."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64
from numpy import ndarray
from scipy import ndimage
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from instdrive_core.masks.lidar.clusters import cluster_points
from instdrive_core.tracks.range_images import Votes
from instdrive_core.tracks.sweep_clouds import SweepCloud

REACH, REACH_PER_METRE, MAX_REACH = 0.35, 0.01, 1.0
"""Metres within which points hang together: right at the sensor, per metre of range, at most."""
MIN_POINTS = 5
CAR = (6.0, 3.0)
"""Metres along and across that a cluster taken whole measures at most; corners seen aslant look wider than a car."""
MOVING_SHARE, MOVING_EXTENT = 0.3, 0.5
"""Share of its points that must not be confirmed to stand, and of its length that they must span: a person beside a
hedge spans only the one end."""
NEAR_CELL = 2.0
"""Metres along an edge of the cells by which points far from all that may move are left out."""
MAX_LENGTH, MAX_WIDTH = 20.0, 8.0
"""Metres: what measures more along both axes of the world is no vehicle."""


@dataclass(frozen=True, eq=False)
class Cluster:
    """Points of one sweep that hang together."""

    sweep: int
    """Position among the clouds."""
    rows: Int64[ndarray, " k"]
    """In the cloud."""
    points: Float32[ndarray, "k 3"]
    """Metres, z above the ground."""
    time: float
    """Mean time of its points, seconds."""
    low: Float64[ndarray, "3"]
    high: Float64[ndarray, "3"]
    """Corners of the box around it."""
    seen_through: float
    """Share of the points at whose places others saw through."""

    @property
    def middle(self) -> Float64[ndarray, "2"]:
        """Centre of the box around it, along the ground."""
        return (self.low[:2] + self.high[:2]) / 2


def find_candidates(cloud: SweepCloud, votes: Votes, sweep: int) -> list[Cluster]:
    """The clusters of a sweep that may move.

    A cluster of vehicle size is taken whole where enough of its points are not confirmed to stand: the sides of a
    creeping car look as if they stood. Of larger ones, and those that mostly stand, only the other points are taken.
    """
    if not len(cloud.points):
        return []
    moves = ~votes.is_static
    whole = cluster_cloud(cloud, np.flatnonzero(_find_near_moving(cloud, moves)))
    parts = [part for part in whole if _is_creeping_vehicle(cloud.points[part], moves[part])]
    taken = np.zeros(len(moves), bool)
    taken[np.concatenate([np.zeros(0, np.int64), *parts])] = True
    parts += cluster_cloud(cloud, np.flatnonzero(moves & ~taken))
    return [
        make_cluster(cloud, votes.is_seen_through, np.sort(part), sweep)
        for part in parts
        if len(part) >= MIN_POINTS and not _is_huge(cloud.points[part])
    ]


def _find_near_moving(cloud: SweepCloud, moves: Bool[ndarray, " n"]) -> Bool[ndarray, " n"]:
    """Points within reach, along the ground, of ones that may move: all others need not be clustered."""
    cells = np.floor(cloud.points[:, :2] / NEAR_CELL).astype(np.int64)
    cells -= cells.min(axis=0)
    width, depth = (cells.max(axis=0) + 1).tolist()
    counts = np.zeros((width, depth), bool)
    counts[cells[moves, 0], cells[moves, 1]] = True
    return ndimage.binary_dilation(counts, np.ones((3, 3)))[cells[:, 0], cells[:, 1]]


def cluster_cloud(cloud: SweepCloud, rows: Int64[ndarray, " r"]) -> list[Int64[ndarray, " k"]]:
    """Rows of the points that hang together, cluster by cluster."""
    if not len(rows):
        return []
    reach = np.minimum(REACH + REACH_PER_METRE * cloud.distance[rows], MAX_REACH).astype(np.float32)
    numbers = _rejoin_clusters(cloud.points[rows], cluster_points(cloud.points[rows], reach), reach)
    order = np.argsort(numbers, kind="stable")
    return np.split(rows[order], np.flatnonzero(np.diff(numbers[order])) + 1)


def make_cluster(
    cloud: SweepCloud, seen_through: Bool[ndarray, " n"], rows: Int64[ndarray, " k"], sweep: int
) -> Cluster:
    """Some points of a cloud as a cluster."""
    points = cloud.points[rows]
    low, high = points.min(axis=0).astype(float), points.max(axis=0).astype(float)
    time = float(cloud.times[rows].mean())
    return Cluster(sweep, rows, points, time, low, high, float(seen_through[rows].mean()))


def _is_creeping_vehicle(points: Float32[ndarray, "k 3"], moves: Bool[ndarray, " k"]) -> bool:
    """Whether points fit a car, however it is turned, and those that may move are enough and lie all over it."""
    if moves.mean() < MOVING_SHARE:
        return False
    places = points[:, :2] - points[:, :2].mean(axis=0)
    if np.linalg.norm(np.ptp(places, axis=0)) > CAR[0] + CAR[1]:
        return False
    _, axes = np.linalg.eigh(places.T @ places)
    turned = places @ axes
    across, along = np.ptp(turned, axis=0)
    spanned = np.ptp(turned[moves, 1])
    return bool(along < CAR[0] and across < CAR[1] and spanned >= MOVING_EXTENT * along)


def _is_huge(points: Float32[ndarray, "k 3"]) -> bool:
    extent = np.sort(np.ptp(points[:, :2], axis=0))
    return bool(extent[1] > MAX_LENGTH or extent[0] > 2 * MAX_WIDTH)


def _rejoin_clusters(points: Float32[ndarray, "n 3"], numbers: ndarray, reach: Float32[ndarray, " n"]) -> ndarray:
    """The clusters with those joined that touch: on dense surfaces a point's nearest neighbours are all of its own."""
    count = int(numbers.max()) + 1
    pairs = KDTree(points[:, :2]).query_pairs(float(REACH), output_type="ndarray")
    if not len(pairs):
        return numbers
    first, second = numbers[pairs[:, 0]], numbers[pairs[:, 1]]
    apart = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
    touching = (first != second) & (apart < np.minimum(reach[pairs[:, 0]], reach[pairs[:, 1]]))
    links = (np.ones(int(touching.sum()), bool), (first[touching], second[touching]))
    return connected_components(coo_matrix(links, shape=(count, count)), directed=False)[1][numbers]
