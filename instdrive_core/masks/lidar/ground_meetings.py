"""Where pieces of the ground meet: how much one lies above the other, and which of them are one."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from functools import cached_property
from heapq import heapify, heappop, heappush

import numpy as np
from jaxtyping import Float64, Int64
from numpy import ndarray
from scipy import ndimage
from scipy.spatial import KDTree

KERB, SAME_SIDE = 0.04, 0.75
"""Metres that half of the places where two pieces meet rise at least, and share of them that rise to the same side.
A kerb of 14 cm measures 5 to 7, less its doubt; ruts and patches of roads 2."""
LEAST_PLACES = 4
"""Places where two pieces meet below which these say nothing."""
GAP, BEND = 6.0, 0.03
"""Metres behind a car, which is 5 m long, across which ground goes on, and by how much it may rise or fall for each of
them beyond its slopes: a step there counts as so much lower."""
AROUND, STIFFNESS = 2.5, 0.01
"""Metres around a cell whose heights tell how the ground goes on from it, and square metres that its slope's spread is
made larger by: strips tell no slope across."""


@dataclass(frozen=True)
class Meeting:
    """Where a piece meets one with a larger number."""

    rises: Float64[ndarray, " k"]
    """Metres that the one with the larger number lies higher, by place."""

    @cached_property
    def attraction(self) -> float:
        """How many places say that the two are one, less those that say that a kerb parts them."""
        middle = float(np.median(self.rises))
        agreeing = int(np.count_nonzero(self.rises * middle > 0))
        step = abs(middle) if agreeing >= SAME_SIDE * len(self.rises) else 0.0
        return len(self.rises) * (1 - min(step / KERB, 2))

    @property
    def is_step(self) -> bool:
        """Whether a kerb parts the two."""
        return self.attraction <= 0


Meetings = dict[tuple[int, int], Meeting]
"""By the two pieces' numbers, ascending."""


def measure_borders(pieces: Int64[ndarray, "x y"], rises: Float64[ndarray, "x y 2"]) -> Meetings:
    """Measure pieces that touch by the steps between their cells.

    Args:
        pieces: of each cell, from 1; 0 = none.
        rises: metres, as vectors to the higher side, NaN where nothing is known (`ground_steps`).
    """
    found = []
    for axis in (0, 1):
        before = tuple(slice(None, -1) if other == axis else slice(None) for other in (0, 1))
        after = tuple(slice(1, None) if other == axis else slice(None) for other in (0, 1))
        touching = (pieces[before] != pieces[after]) & (pieces[before] > 0) & (pieces[after] > 0)
        ways = np.stack([rises[before][touching], rises[after][touching]], axis=1)
        lengths = np.nan_to_num(np.linalg.norm(ways, axis=2), nan=-1)
        rows, higher = np.arange(len(ways)), np.argmax(lengths, axis=1)
        signed = lengths[rows, higher] * np.sign(ways[rows, higher, axis])
        found.append((pieces[before][touching], pieces[after][touching], signed))
    return _group(*(np.concatenate(column) for column in zip(*found, strict=True)))


def measure_gaps(
    pieces: Int64[ndarray, "x y"], heights: Float64[ndarray, "x y"], cell: float, known: Meetings
) -> Meetings:
    """Measure pieces that lie within `GAP` of each other by where they would meet in its middle, each along its slope.

    Args:
        pieces: of each cell, from 1; 0 = none.
        heights: metres, NaN where nothing is known.
        cell: metres along an edge of a cell.
        known: pieces whose border was measured; they are left out.
    """
    rim = (pieces > 0) & np.asarray(ndimage.binary_dilation(pieces == 0), bool) & np.isfinite(heights)
    cells, named = np.argwhere(rim), pieces[rim]
    pairs = _find_facing(cells, named, GAP / cell)
    ends = np.sort(named[pairs], axis=1)
    pairs = pairs[~np.isin(ends[:, 0] << 32 | ends[:, 1], [low << 32 | high for low, high in known])]
    used, place = np.unique(pairs, return_inverse=True)
    planes = _fit_planes(cells[used], pieces, heights, cell)[place.reshape(pairs.shape)]
    offsets = (cells[pairs].mean(axis=1, keepdims=True) - cells[pairs]) * cell
    ahead = planes[..., 0] + (planes[..., 1:] * offsets).sum(axis=2)
    rises = ahead[:, 1] - ahead[:, 0]
    doubt = BEND * 2 * np.linalg.norm(offsets[:, 0], axis=1)
    return _group(named[pairs[:, 0]], named[pairs[:, 1]], np.sign(rises) * np.maximum(np.abs(rises) - doubt, 0))


def _find_facing(cells: Int64[ndarray, "r 2"], pieces: Int64[ndarray, " r"], reach: float) -> Int64[ndarray, "k 2"]:
    """Find the nearest cell of each other piece within reach (in cells), for each cell: pairs of rows."""
    if not len(cells):
        return np.zeros((0, 2), np.int64)
    pairs = KDTree(cells).query_pairs(reach, output_type="ndarray").astype(np.int64)
    pairs = pairs[pieces[pairs[:, 0]] != pieces[pairs[:, 1]]]
    pairs = np.concatenate([pairs, pairs[:, ::-1]])
    away = np.linalg.norm(cells[pairs[:, 0]] - cells[pairs[:, 1]], axis=1)
    order = np.lexsort((pairs[:, 1], away, pieces[pairs[:, 1]], pairs[:, 0]))
    keys = np.column_stack([pairs[:, 0], pieces[pairs[:, 1]]])[order]
    return pairs[order[(np.diff(keys, axis=0, prepend=-1) != 0).any(axis=1)]]


def join_level(meetings: Meetings, count: int) -> tuple[Int64[ndarray, " c"], Meetings]:
    """Join pieces until a kerb parts all that meet; what was joined meets others as one.

    The longest level border goes first. So most of a road is one, and most of a pavement, before a driveway level with
    both joins one of them: by then, a kerb is most of the border between these two (greedy additive edge contraction,
    Keuper et al., ICCV 2015).

    Args:
        meetings: of pieces.
        count: more than the highest number.

    Returns:
        The number that each piece has now, and how those that are left meet.
    """
    left, around = dict(meetings), defaultdict(set)
    for low, high in left:
        around[low].add(high)
        around[high].add(low)
    queue = [(-meeting.attraction, pair) for pair, meeting in left.items() if not meeting.is_step]
    heapify(queue)
    names = np.arange(count)
    while queue:
        attraction, (kept, gone) = heappop(queue)
        meeting = left.get((kept, gone))
        if meeting is None or meeting.is_step or meeting.attraction != -attraction:
            continue  # either has joined another since
        del left[kept, gone]
        names[names == gone] = kept
        around[kept].discard(gone)
        for third in around.pop(gone) - {kept}:
            around[third].discard(gone)
            old, new = (min(gone, third), max(gone, third)), (min(kept, third), max(kept, third))
            rises = left.pop(old).rises * (1 if (gone < third) == (kept < third) else -1)
            left[new] = Meeting(np.concatenate([left[new].rises, rises]) if new in left else rises)
            around[kept].add(third)
            around[third].add(kept)
            if not left[new].is_step:
                heappush(queue, (-left[new].attraction, new))
    return names, left


def _group(first: Int64[ndarray, " k"], second: Int64[ndarray, " k"], rises: Float64[ndarray, " k"]) -> Meetings:
    """Group places by the pieces that meet there, `rises` being how much higher the second one lies."""
    told = np.isfinite(rises)
    turned = first > second
    ends = np.sort(np.column_stack([first, second])[told], axis=1)
    between, pair, counts = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
    rises = np.where(turned, -rises, rises)[told][np.argsort(pair.ravel(), kind="stable")]
    ends_of_parts = np.cumsum(counts)
    return {
        (low, high): Meeting(rises[end - size : end])
        for (low, high), end, size in zip(between.tolist(), ends_of_parts, counts, strict=True)
        if size >= LEAST_PLACES
    }


def _fit_planes(
    cells: Int64[ndarray, "k 2"], pieces: Int64[ndarray, "x y"], heights: Float64[ndarray, "x y"], cell: float
) -> Float64[ndarray, "k 3"]:
    """Fit a plane to the heights of a cell's own piece around it: height there, and rise per metre along x and y."""
    known = np.argwhere((pieces > 0) & np.isfinite(heights))
    found = np.zeros((len(cells), 3))
    around = KDTree(known * cell).query_ball_point(cells * cell, AROUND)
    for row, (place, rows) in enumerate(zip(cells, around, strict=True)):
        near = known[rows]
        near = near[pieces[tuple(near.T)] == pieces[tuple(place)]]
        offsets = (near - place) * cell
        values = heights[tuple(near.T)]
        off = offsets - offsets.mean(axis=0)
        spread = off.T @ off + STIFFNESS * len(off) * np.eye(2)
        slope = np.linalg.solve(spread, off.T @ (values - values.mean()))
        found[row] = values.mean() - slope @ offsets.mean(axis=0), *slope
    return found
