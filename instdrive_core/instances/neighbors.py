"""Nearest neighbours among points of the same label: one k-d tree per label, side by side in one array.

Every node halves its points at the median of its box's longest side, so a tree is nothing but an order of the points
and a box per node. The order depends on the points alone, not on the number of threads.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Float, Float64, Int32, Int64
from numpy import ndarray

_LEAF = 12
"""Points that are not halved any further."""
_PIECE = 1 << 14
"""Points of a branch that one thread grows by itself."""
_CHUNK = 256
"""Queries that one thread answers at a time."""
_DEPTH = 64
"""Nodes that a search may have left to look at: more than a tree of 2³² points has levels."""


@dataclass(frozen=True)
class NeighborForest:
    """Points in the order of their trees."""

    points: Float64[ndarray, "m 3"]
    rows: Int64[ndarray, " m"]
    """Number of each point where it came from."""
    starts: Int64[ndarray, " l1"]
    """The points of label l are `starts[l]:starts[l + 1]`."""
    boxes: Float64[ndarray, "m 6"]
    """Lowest and highest corner of the node whose middle point stands there."""

    def find_nearest(
        self,
        queries: Float[ndarray, "q 3"],
        labels: Int64[ndarray, " q"],
        count: int,
        reach: Float[ndarray, " q"],
        ranks: Int64[ndarray, " m"] | None = None,
        below: Int64[ndarray, " q"] | None = None,
    ) -> tuple[Float64[ndarray, "q k"], Int32[ndarray, "q k"]]:
        """Find the `count` nearest points of each query's own label: their distances, rising, and their numbers.

        Args:
            queries: any places.
            labels: 0 … l - 1.
            count: how many neighbours; where there are fewer, the rest has distance inf and number -1.
            reach: points farther than this from the query are no neighbours.
            ranks: of each point, by its number, and
            below: of each query: only points of a lower rank than this are neighbours. Given together or not at all.
        """
        if ranks is None or below is None:
            ranks, below = np.zeros(len(self.rows), np.int64), np.ones(len(queries), np.int64)
        distances, found = np.empty((len(queries), count)), np.empty((len(queries), count), np.int32)
        places = np.arange(len(queries))
        lowest = _find_lowest_ranks(self.rows, self.starts, ranks)
        _answer(self.points, self.rows, self.starts, self.boxes, ranks, lowest,
                np.ascontiguousarray(queries, np.float64), labels, below, places,
                np.ascontiguousarray(reach, np.float64), distances, found)  # fmt: skip
        return distances, found

    def find_nearest_to_each(
        self, count: int, reach: Float[ndarray, " m"]
    ) -> tuple[Float64[ndarray, "m k"], Int32[ndarray, "m k"]]:
        """Find the nearest points to each of the forest's own, by number; each is its own first neighbour."""
        distances, found = np.empty((len(self.rows), count)), np.empty((len(self.rows), count), np.int32)
        labels = np.repeat(np.arange(len(self.starts) - 1), np.diff(self.starts))
        # In the order of the trees one query looks at the points that the last one has just read.
        ranks, below = np.zeros(len(self.rows), np.int64), np.ones(len(self.rows), np.int64)
        _answer(self.points, self.rows, self.starts, self.boxes, ranks, ranks,
                self.points, labels, below, self.rows,
                reach[self.rows].astype(np.float64), distances, found)  # fmt: skip
        return distances, found


def build_forest(points: Float[ndarray, "m 3"], labels: Int64[ndarray, " m"]) -> NeighborForest:
    """Build the trees of finite points with labels from 0 on."""
    count = len(points)
    sizes = np.bincount(labels)
    starts = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    rows = _sort_by_label(labels, starts)
    placed = np.asarray(points, np.float64)[rows]
    boxes = np.empty((count, 6))
    pieces = np.stack([starts[:-1], starts[1:]], axis=1)[sizes > 0]
    while len(pieces) and np.max(pieces[:, 1] - pieces[:, 0]) > _PIECE:
        large = pieces[:, 1] - pieces[:, 0] > _PIECE
        _halve(placed, rows, boxes, pieces[large])
        middles = pieces[large].sum(axis=1) // 2
        halves = [np.stack([pieces[large, 0], middles], axis=1), np.stack([middles, pieces[large, 1]], axis=1)]
        pieces = np.concatenate([pieces[~large], *halves])
    _grow(placed, rows, boxes, pieces)
    return NeighborForest(placed, rows, starts, boxes)


@numba.njit(cache=True)
@no_type_check
def _sort_by_label(labels, starts):
    """Sort the numbers of the points label by label, rising."""
    places, rows = starts.copy(), np.empty(len(labels), np.int64)
    for row in range(len(labels)):
        rows[places[labels[row]]] = row
        places[labels[row]] += 1
    return rows


@numba.njit(cache=True, parallel=True, error_model="numpy")
@no_type_check
def _halve(points, rows, boxes, pieces):
    for k in numba.prange(len(pieces)):
        _split(points, rows, boxes, pieces[k, 0], pieces[k, 1])


@numba.njit(cache=True, parallel=True, error_model="numpy")
@no_type_check
def _grow(points, rows, boxes, pieces):
    for k in numba.prange(len(pieces)):
        left = np.empty((_DEPTH, 2), np.int64)
        left[0, 0], left[0, 1] = pieces[k, 0], pieces[k, 1]
        waiting = 1
        while waiting:
            waiting -= 1
            start, stop = left[waiting, 0], left[waiting, 1]
            if _split(points, rows, boxes, start, stop):
                middle = (start + stop) // 2
                left[waiting, 0], left[waiting, 1] = start, middle
                left[waiting + 1, 0], left[waiting + 1, 1] = middle, stop
                waiting += 2


@numba.njit(cache=True, error_model="numpy")
@no_type_check
def _split(points, rows, boxes, start, stop):
    """Box a node and put the lower half of its points first; False for a leaf, which stays as it is."""
    middle = (start + stop) // 2
    axis, longest = 0, -1.0
    for a in range(3):
        low = high = points[start, a]
        for k in range(start + 1, stop):
            low, high = min(low, points[k, a]), max(high, points[k, a])
        boxes[middle, a], boxes[middle, 3 + a] = low, high
        if high - low > longest:
            axis, longest = a, high - low
    if stop - start <= _LEAF:
        return False
    _select(points, rows, axis, start, stop - 1, middle)
    return True


@numba.njit(cache=True, error_model="numpy")
@no_type_check
def _select(points, rows, axis, first, last, middle):
    """Hoare's selection: nothing before `middle` is greater, nothing after it smaller."""
    while first < last:
        a, b, c = points[first, axis], points[(first + last) // 2, axis], points[last, axis]
        pivot = max(min(a, b), min(max(a, b), c))
        i, j = first, last
        while i <= j:
            while points[i, axis] < pivot:
                i += 1
            while points[j, axis] > pivot:
                j -= 1
            if i <= j:
                for a in range(3):
                    x = points[i, a]
                    points[i, a] = points[j, a]
                    points[j, a] = x
                row = rows[i]
                rows[i] = rows[j]
                rows[j] = row
                i += 1
                j -= 1
        if middle <= j:
            last = j
        elif middle >= i:
            first = i
        else:
            return


@numba.njit(cache=True)
@no_type_check
def _find_lowest_ranks(rows, starts, ranks):
    """Find the lowest rank among the points of each node: where none is below a query's, the search passes it over."""
    lowest = np.empty(len(rows), np.int64)
    nodes = np.empty((_DEPTH, 2), np.int64)
    for label in range(len(starts) - 1):
        if starts[label] == starts[label + 1]:
            continue
        nodes[0, 0], nodes[0, 1], waiting = starts[label], starts[label + 1], 1
        while waiting:
            start, stop = nodes[waiting - 1, 0], nodes[waiting - 1, 1]
            middle = (start + stop) // 2
            if start < 0:  # both halves are done
                start = -1 - start
                middle = (start + stop) // 2
                lowest[middle] = min(lowest[(start + middle) // 2], lowest[(middle + stop) // 2])
                waiting -= 1
            elif stop - start <= _LEAF:
                lowest[middle] = ranks[rows[start]]
                for k in range(start + 1, stop):
                    lowest[middle] = min(lowest[middle], ranks[rows[k]])
                waiting -= 1
            else:
                nodes[waiting - 1, 0] = -1 - start
                nodes[waiting, 0], nodes[waiting, 1] = start, middle
                nodes[waiting + 1, 0], nodes[waiting + 1, 1] = middle, stop
                waiting += 2
    return lowest


@numba.njit(cache=True, parallel=True, error_model="numpy")
@no_type_check
def _answer(points, rows, starts, boxes, ranks, lowest, queries, labels, below, places, reach, distances, found):
    """Answer all queries; query q's neighbours go to row `places[q]` of the results."""
    for chunk in numba.prange((len(queries) + _CHUNK - 1) // _CHUNK):
        left, away = np.empty((_DEPTH, 2), np.int64), np.empty(_DEPTH)
        for q in range(chunk * _CHUNK, min(len(queries), (chunk + 1) * _CHUNK)):
            squares, numbers = distances[places[q]], found[places[q]]
            squares[:] = np.inf
            numbers[:] = -1
            start, stop = starts[labels[q]], starts[labels[q] + 1]
            if start < stop:
                _search(points, rows, boxes, ranks, lowest, start, stop, queries[q], below[q], reach[q], left, away,
                        squares, numbers)  # fmt: skip
            for k in range(len(squares)):
                squares[k] = np.sqrt(squares[k])


@numba.njit(cache=True, error_model="numpy")
@no_type_check
def _search(points, rows, boxes, ranks, lowest, start, stop, query, below, reach, left, away, squares, numbers):
    """Search a tree, nearer child first; a node that cannot hold a point nearer than the worst kept one is skipped."""
    x, y, z = query[0], query[1], query[2]
    last, limit = len(squares) - 1, reach * reach
    left[0, 0], left[0, 1], away[0] = start, stop, _compute_square_to_box(boxes, (start + stop) // 2, x, y, z)
    waiting = 1
    while waiting:
        waiting -= 1
        if away[waiting] > limit:
            continue
        start, stop = left[waiting, 0], left[waiting, 1]
        while stop - start > _LEAF:
            middle = (start + stop) // 2
            one, other = (start + middle) // 2, (middle + stop) // 2
            lower = _compute_square_to_box(boxes, one, x, y, z) if lowest[one] < below else np.inf
            upper = _compute_square_to_box(boxes, other, x, y, z) if lowest[other] < below else np.inf
            if lower <= upper:
                left[waiting, 0], left[waiting, 1], away[waiting] = middle, stop, upper
                stop = middle
            else:
                left[waiting, 0], left[waiting, 1], away[waiting] = start, middle, lower
                start = middle
            waiting += away[waiting] <= limit and away[waiting] < np.inf
        for k in range(start, stop):
            dx, dy, dz = points[k, 0] - x, points[k, 1] - y, points[k, 2] - z
            square = dx * dx + dy * dy + dz * dz
            if square <= limit and square < squares[last] and ranks[rows[k]] < below:
                place = last
                while place > 0 and squares[place - 1] > square:
                    squares[place], numbers[place] = squares[place - 1], numbers[place - 1]
                    place -= 1
                squares[place], numbers[place] = square, rows[k]
                limit = min(limit, squares[last])


@numba.njit(cache=True, error_model="numpy")
@no_type_check
def _compute_square_to_box(boxes, node, x, y, z):
    dx = max(boxes[node, 0] - x, x - boxes[node, 3], 0.0)
    dy = max(boxes[node, 1] - y, y - boxes[node, 4], 0.0)
    dz = max(boxes[node, 2] - z, z - boxes[node, 5], 0.0)
    return dx * dx + dy * dy + dz * dz
