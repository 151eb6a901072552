"""Facades, walls and plants as wholes: windows, posts and what stands before them cut them in pieces that hang together
in plan. A fence that begins at the corner of a house is none of its facade, though: it ends lower."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float32, Int32, Int64, UInt32
from numpy import ndarray
from scipy import ndimage
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from instdrive_core.masks.lidar.cluster_kind import BACKDROP, FACADE, TALL, THING, VEGETATION, WALL, find_furniture
from instdrive_core.masks.lidar.clusters import thin_rows

CELL = 0.25
"""Metres along an edge of the cells that stand for a piece in plan."""
GAP, GAP_PER_METRE, MAX_GAP = 1.0, 0.02, 2.5
"""Metres along the ground between pieces of one facade, wall or plant: at least, per metre of distance from the sensor,
at most."""
COLUMN = 0.5
"""Metres along an edge of the columns whose tops tell walls from facades."""
BESIDE = 2
"""Columns on each side of a tall one that count as tall, too: windows and doors have no points above them."""
UNSEEN = 0.3
"""Metres below the highest beam from which on a column may go on above it."""
WALL_RUN = 4.0
"""Metres along the ground of the shortest wall that is told from the facade it touches."""
FAR = 30.0
"""Metres from the sensor's path from which on points hang together over more than the width of a person."""
VERY_FAR = 60.0
"""Metres from which on points hang together as far as they ever may (`scene.MAX_REACH`): shapes blur."""
ON_WALL = 0.6
"""Share of a fence's upper points that lie above its lower ones."""


def part_walls(
    points: Float32[ndarray, "n 3"],
    clusters: Int32[ndarray, " n"],
    kinds: UInt32[ndarray, " c"],
    above: Float32[ndarray, " n"],
    ceiling: Float32[ndarray, " n"],
) -> tuple[Int32[ndarray, " n"], UInt32[ndarray, " d"]]:
    """Part runs of low columns from facades, as clusters of their own of kind `WALL`, numbered after the others.

    A column is low if it surely ends below any facade: lower than the highest beam looks there, and far enough from
    tall columns.

    Args:
        points: metres.
        clusters: number by point.
        kinds: kind by number (`cluster_kind`).
        above: metres above the ground.
        ceiling: metres above the ground at which the highest beam passes each point.
    """
    rows = np.flatnonzero(kinds[clusters] == FACADE)
    if not len(rows):
        return clusters, kinds
    cells = np.floor(points[rows, :2] / COLUMN).astype(np.int64)
    cells -= cells.min(axis=0) - BESIDE
    shape = tuple((cells.max(axis=0) + 1 + BESIDE).tolist())
    tall = np.zeros(shape, bool)
    high = (above[rows] > TALL) | (above[rows] > ceiling[rows] - UNSEEN)
    tall[cells[high, 0], cells[high, 1]] = True
    ndimage.binary_dilation(tall.copy(), np.ones((3, 3)), iterations=BESIDE, output=tall)
    lower = ~tall[cells[:, 0], cells[:, 1]]
    low = rows[lower]
    runs = _find_runs(cells[lower], clusters[low])
    parted = clusters.copy()
    parted[low[runs >= 0]] = len(kinds) + runs[runs >= 0]
    return parted, np.append(kinds, np.full(int(runs.max(initial=-1)) + 1, WALL, np.uint32))


def _find_runs(cells: Int64[ndarray, "n 2"], clusters: Int32[ndarray, " n"]) -> Int32[ndarray, " n"]:
    """Number runs of cells of one cluster that hang together, from 0; -1 where they are too short."""
    if not len(cells):
        return np.zeros(0, np.int32)
    places, of_point = np.unique(np.column_stack([clusters, cells]), axis=0, return_inverse=True)
    apart = places * [4, 1, 1]  # cells of different clusters never touch
    pairs = KDTree(apart).query_pairs(1.5, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs), bool), (pairs[:, 0], pairs[:, 1])), shape=(len(places),) * 2)
    count, runs = connected_components(graph, directed=False)
    low, high = np.full((count, 2), np.iinfo(np.int64).max), np.full((count, 2), np.iinfo(np.int64).min)
    np.minimum.at(low, runs, places[:, 1:])
    np.maximum.at(high, runs, places[:, 1:])
    long = COLUMN * np.linalg.norm(high - low + 1, axis=1) >= WALL_RUN
    numbers = np.where(long, np.cumsum(long) - 1, -1).astype(np.int32)
    return numbers[runs][of_point.ravel()]


def join_wide(
    points: Float32[ndarray, "n 3"],
    clusters: Int32[ndarray, " n"],
    kinds: UInt32[ndarray, " c"],
    distance: Float32[ndarray, " n"],
) -> Int32[ndarray, " n"]:
    """Join pieces of facades that lie close to each other in plan, whatever their heights; so pieces of walls,
    of plants, and of the backdrop.

    A piece takes the number of the lowest one that it hangs together with.

    Args:
        points: metres.
        clusters: number by point.
        kinds: kind by number (`cluster_kind`).
        distance: metres from the sensor's path.
    """
    wide = np.isin(kinds, (FACADE, WALL, VEGETATION, BACKDROP))
    rows = np.flatnonzero(wide[clusters])
    if not len(rows):
        return clusters
    flat = np.column_stack([points[rows, :2], CELL * clusters[rows]]).astype(np.float32)  # one level for each piece
    cells = rows[thin_rows(flat, CELL)]
    pairs = KDTree(points[cells, :2]).query_pairs(MAX_GAP, output_type="ndarray")
    one, other = cells[pairs[:, 0]], cells[pairs[:, 1]]
    gap = np.linalg.norm(points[one, :2] - points[other, :2], axis=1)
    near = gap < np.clip(GAP_PER_METRE * np.minimum(distance[one], distance[other]), GAP, MAX_GAP)
    near &= (clusters[one] != clusters[other]) & (kinds[clusters[one]] == kinds[clusters[other]])
    touching = np.unique(np.column_stack([clusters[one[near]], clusters[other[near]]]), axis=0)
    graph = coo_matrix((np.ones(len(touching), bool), (touching[:, 0], touching[:, 1])), shape=(len(kinds),) * 2)
    _, whole = connected_components(graph, directed=False)
    lowest = np.full(int(whole.max()) + 1, len(kinds))
    np.minimum.at(lowest, whole, np.arange(len(kinds)))
    return lowest[whole][clusters].astype(np.int32)


def recognize_stuff(
    points: Float32[ndarray, "n 3"],
    clusters: Int32[ndarray, " n"],
    kinds: UInt32[ndarray, " c"],
    above: Float32[ndarray, " n"],
    distance: Float32[ndarray, " n"],
    posts_apart: bool,
) -> UInt32[ndarray, " c"]:
    """Recognize what one cluster alone does not tell; returns the kinds.

    What looks like foliage but stands on a wall and ends as low is the upper part of a fence. Far posts, signs and
    lamps count as walls: points there do not tell them from what stands around them. What is wide and even farther
    away is backdrop.

    Args:
        points: metres.
        clusters: number by point.
        kinds: kind by number (`cluster_kind`).
        above: metres above the ground.
        distance: metres from the sensor's path.
        posts_apart: far posts, signs and lamps stay things.
    """
    if not len(points):
        return kinds
    counts = np.maximum(np.bincount(clusters, minlength=len(kinds)), 1)
    mean_distance = np.bincount(clusters, distance, len(kinds)) / counts
    furniture = (kinds == THING) & (mean_distance > FAR) & find_furniture(points, clusters, above, len(kinds))
    found = np.where(_find_fence_tops(points, clusters, kinds, above), WALL, kinds).astype(np.uint32)
    if not posts_apart:
        found[furniture] = WALL
    found[np.isin(found, (FACADE, WALL, VEGETATION)) & (mean_distance > VERY_FAR)] = BACKDROP
    return found


def _find_fence_tops(
    points: Float32[ndarray, "n 3"],
    clusters: Int32[ndarray, " n"],
    kinds: UInt32[ndarray, " c"],
    above: Float32[ndarray, " n"],
) -> Bool[ndarray, " c"]:
    """Find plants that stand on walls and are no trees."""
    walls, plants = kinds[clusters] == WALL, kinds[clusters] == VEGETATION
    if not walls.any() or not plants.any():
        return np.zeros(len(kinds), bool)
    gaps, _ = KDTree(points[walls, :2]).query(points[plants, :2], distance_upper_bound=COLUMN)
    counts = np.bincount(clusters[plants], minlength=len(kinds))
    on_wall = np.bincount(clusters[plants], np.isfinite(gaps), len(kinds)) > ON_WALL * counts
    top = np.zeros(len(kinds))
    np.maximum.at(top, clusters[plants], above[plants])
    return (counts > 0) & on_wall & (top < TALL)
