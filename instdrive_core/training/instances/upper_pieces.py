"""What hangs on a wall belongs to the house beneath: the upper storeys that segmenters show apart from the lower ones.

From close by, no photo shows a house as one mask: a storey, a gable or a row of windows is one, in each photo the same.
But nothing stands in the air. A piece that begins above people and cars is carried by what ends where it begins.
"""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float32, Float64, Int64, UInt16
from numpy import ndarray
from scipy.spatial import KDTree

from instdrive_core.maths.groups import split_by_group

STANDING = 2.0
"""Metres above the ground: what begins lower stands there, on its own or behind what hides its foot, and what ends
lower carries nothing: cars, people, bins."""
STRAYS = 0.05
"""Share of a group's light, at either end, that is left out where its foot and its top are looked for."""
STEEP = 0.35
"""Largest upward part of the normals of walls."""
WALL_SHARE = 0.3
"""Least share of a carrier's light on steep Gaussians: walls blur along their edges, roofs and pavements have none."""
SQUARE = 0.3
"""Least length of the mean of exp(4i·bearing) over a piece's steep normals: 1 where walls meet at right angles, 0 where
a crown faces everywhere."""
WIDE = 2.0
"""Least metres that a piece measures along the ground: signs and boxes hang before houses, too."""
COLUMN = 0.5
"""Metres along a side of the columns in which a piece looks down."""
AROUND = 0.75
"""Metres to each side of a column's middle …"""
BELOW = 1.0
"""… and below the piece's lowest part there, in which its carrier ends."""
MIN_CARRYING = 3
"""Gaussians of a group there from which on it carries the piece."""
CARRIED = 0.5
"""Share of a piece, by light, of which one group carries more: what lies on two houses alike belongs to neither."""


def join_upper_pieces(
    groups: Int64[ndarray, " n"],
    shown: Float32[ndarray, " n"],
    nodes: UInt16[ndarray, " n"],
    means: Float32[ndarray, "n 3"],
    normals: Float64[ndarray, "n 3"],
    ground: Float32[ndarray, "p 3"],
) -> Int64[ndarray, " n"]:
    """Give pieces of walls that hang above the ground to the one group that carries them.

    Args:
        groups: of each Gaussian; -1 = none.
        shown: how much of the photos each shows; 0 = it has no say.
        nodes: 0 = it stands still; groups that hold others stay as they are.
        means: metres, in the world; z is up.
        normals: unit vectors of any sign.
        ground: LiDAR points of the ground.
    """
    told = np.flatnonzero((shown > 0) & (groups >= 0) & ~np.isin(groups, groups[nodes > 0]))
    if not len(told) or not len(ground):
        return groups
    _, below = KDTree(ground[:, :2]).query(means[told, :2], workers=numba.get_num_threads())
    places = np.column_stack([means[told, :2], means[told, 2] - ground[below, 2]]).astype(np.float64)
    told_normals, light = normals[told], shown[told].astype(np.float64)
    joined, count = groups, int(groups.max()) + 1
    while True:
        names = _name_carriers(joined[told], places, told_normals, light, count)
        following = np.where(groups >= 0, names[joined], -1)
        if np.array_equal(following, joined):
            return joined
        joined = following


def _name_carriers(
    named: Int64[ndarray, " m"],
    places: Float64[ndarray, "m 3"],
    normals: Float64[ndarray, "m 3"],
    light: Float64[ndarray, " m"],
    count: int,
) -> Int64[ndarray, " g"]:
    """Give each group its carrier, or itself; what a house has got carries in the next round."""
    steep = np.abs(normals[:, 2]) < STEEP
    walls = np.bincount(named[steep], light[steep], count) >= WALL_SHARE * np.bincount(named, light, count)
    feet, tops = _measure_feet_and_tops(places[:, 2], light, named, count)
    hangs = feet > STANDING
    carriers = np.flatnonzero(steep & (walls & ~hangs & (tops > STANDING))[named])
    names = np.arange(count)
    if len(carriers):
        tree = KDTree(places[carriers, :2])
        for piece, rows in split_by_group(named, np.flatnonzero(steep & hangs[named])):
            if _faces_squarely(normals[rows], light[rows]) and _measure_width(places[rows, :2]) >= WIDE:
                names[piece] = _find_carrier(
                    piece, places[rows], light[rows], tree, places[carriers, 2], named[carriers]
                )
    return names


def _faces_squarely(normals: Float64[ndarray, "k 3"], light: Float64[ndarray, " k"]) -> bool:
    bearings = np.arctan2(normals[:, 1], normals[:, 0])
    return bool(np.abs(np.average(np.exp(4j * bearings), weights=light)) >= SQUARE)


def _measure_width(places: Float64[ndarray, "k 2"]) -> float:
    """Measure the diagonal of a piece seen from above, its strays left out at both ends."""
    first, last = np.quantile(places, [STRAYS, 1 - STRAYS], axis=0)
    return float(np.hypot(*(last - first)))


def _measure_feet_and_tops(
    heights: Float64[ndarray, " m"], light: Float64[ndarray, " m"], named: Int64[ndarray, " m"], count: int
) -> Float64[ndarray, "2 g"]:
    """Measure how high each group begins and ends; of nothing, both are 0."""
    ends = np.zeros((2, count))
    for group, rows in split_by_group(named, np.arange(len(named))):
        rising = rows[np.argsort(heights[rows], kind="stable")]
        sums = np.cumsum(light[rising])
        ends[:, group] = heights[rising[np.searchsorted(sums, np.array([STRAYS, 1 - STRAYS]) * sums[-1])]]
    return ends


def _find_carrier(
    piece: int,
    places: Float64[ndarray, "k 3"],
    light: Float64[ndarray, " k"],
    tree: KDTree,
    heights: Float64[ndarray, " c"],
    named: Int64[ndarray, " c"],
) -> int:
    """Find the group that carries a piece, or the piece itself where none does.

    `tree`, `heights` and `named` are of the Gaussians of what stands.
    """
    cells, columns = np.unique(np.floor(places[:, :2] / COLUMN).astype(np.int64), axis=0, return_inverse=True)
    columns = columns.ravel()
    lowest = np.full(len(cells), np.inf)
    np.minimum.at(lowest, columns, places[:, 2])
    weights = np.bincount(columns, light, len(cells))
    votes: dict[int, float] = {}
    for number, near in enumerate(tree.query_ball_point((cells + 0.5) * COLUMN, AROUND)):
        beneath = _select_beneath(np.array(near, np.int64), heights, lowest[number])
        if len(beneath) >= MIN_CARRYING:
            found, counts = np.unique(named[beneath], return_counts=True)
            if counts.max() >= MIN_CARRYING:
                carrier = int(found[np.argmax(counts)])
                votes[carrier] = votes.get(carrier, 0.0) + float(weights[number])
    best = max(votes, key=lambda carrier: votes[carrier], default=piece)
    return best if votes.get(best, 0.0) > CARRIED * float(weights.sum()) else piece


def _select_beneath(near: Int64[ndarray, " k"], heights: Float64[ndarray, " c"], lowest: float) -> Int64[ndarray, " b"]:
    return near[(heights[near] < lowest) & (heights[near] > lowest - BELOW)]
