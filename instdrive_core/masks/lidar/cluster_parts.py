"""Clusters that are parts of one object: glass and dark paint return no points, and so cut a car in pieces."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, Int64
from numpy import ndarray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, KDTree, QhullError

from instdrive_core.masks.lidar.cluster_kind import VEHICLE_LENGTH, VEHICLE_TOP, VEHICLE_WIDTH

GAP = 0.6
"""Metres along the ground between parts of one vehicle."""
STANDING_HEIGHT, STANDING_LENGTH = 1.2, 1.0
"""Metres: a part at least so high and at most so long is a person or a post by itself."""
INSIDE = 0.7
"""Share of a cluster's points above the footprint of another from which on they are one object."""
HEADROOM = 0.1
"""Metres above a vehicle's highest point up to which points are part of it."""
SURROUNDED = 0.3
"""Share of a small cluster's points that lie within reach of a larger one for it to be a part of it."""
SPLINTER = 1.2
"""Metres: longer clusters are not joined to others for being surrounded."""
STEP, LEAST_PART = 0.125, 2.0
"""Metres along a row of vehicles: from one place to the next whose highest point is looked at, over twice as much, and
of the least part of a vehicle that a gap may leave."""
DENSE = 100
"""Points per metre along a row of vehicles, without which a gap does not show."""
GAP_TOP = 0.5
"""Share of the lower of two roofs below which what lies between is a gap."""


def join_vehicle_parts(
    points: Float32[ndarray, "n 3"], clusters: Int32[ndarray, " n"], above: Float32[ndarray, " n"]
) -> Int32[ndarray, " n"]:
    """Join parts that together fit one vehicle; clusters are renumbered from 0.

    Args:
        points: metres.
        clusters: number by point; -1 = none, stays so.
        above: metres above the ground.
    """
    rows = np.flatnonzero(clusters >= 0)
    numbers, compact = np.unique(clusters[rows], return_inverse=True)
    order = np.argsort(compact, kind="stable")
    parts = np.split(rows[order], np.flatnonzero(np.diff(compact[order])) + 1) if len(rows) else []
    low = [number for number, part in enumerate(parts) if len(part) >= 3 and above[part].max() < VEHICLE_TOP]
    hulls = {number: _compute_hull(points[parts[number], :2].astype(float)) for number in low}
    low = [number for number in low if _measure_hull(hulls[number])[0] < VEHICLE_LENGTH]
    low.sort(key=lambda number: (-len(parts[number]), number))
    owner = np.arange(len(numbers))
    middles = {number: hulls[number].mean(axis=0) for number in low}
    taken: set[int] = set()
    for first in low:
        if first in taken or _is_standing(parts[first], hulls[first], above):
            continue
        for second in low:
            if second == first or second in taken or owner[second] != second or len(parts[second]) > len(parts[first]):
                continue
            if np.abs(middles[first] - middles[second]).max() > VEHICLE_LENGTH:
                continue
            if _is_one_vehicle(points, parts[first], parts[second], hulls[first], hulls[second], above):
                owner[second] = first
                taken.add(second)
                hulls[first] = _compute_hull(np.concatenate([hulls[first], hulls[second]]))
                middles[first] = hulls[first].mean(axis=0)
    joined = np.full(len(clusters), -1, np.int32)
    joined[rows] = np.unique(owner[compact], return_inverse=True)[1]
    return joined


def part_queues(
    points: Float32[ndarray, "n 3"], clusters: Int32[ndarray, " n"], above: Float32[ndarray, " n"]
) -> Int32[ndarray, " n"]:
    """Part vehicles that stand bumper to bumper; clusters are renumbered from 0.

    What is as narrow as a vehicle but longer is cut across where it is low between two higher parts, each as long as a
    vehicle is at least: a bonnet is never half as high as the lower of the roofs before and behind it, a gap is.

    Args:
        points: metres.
        clusters: number by point, none left out.
        above: metres above the ground.
    """
    order = np.argsort(clusters, kind="stable")
    parts = np.split(order, np.flatnonzero(np.diff(clusters[order])) + 1)
    parted, found = clusters.astype(np.int64), int(clusters.max(initial=-1)) + 1
    while parts:
        part = parts.pop()
        if len(part) < DENSE * VEHICLE_LENGTH or above[part].max() > VEHICLE_TOP:
            continue
        before = _find_gap(points[part, :2].astype(float), above[part])
        if before is not None:
            parted[part[before]], found = found, found + 1
            parts += [part[before], part[~before]]
    return np.unique(parted, return_inverse=True)[1].astype(np.int32)


def _find_gap(places: Float64[ndarray, "k 2"], above: Float32[ndarray, " k"]) -> Bool[ndarray, " k"] | None:
    """Which points lie before the lowest gap in a row of vehicles; None where there is none."""
    hull = _compute_hull(places)
    length, width = _measure_hull(hull)
    if length < VEHICLE_LENGTH or width > VEHICLE_WIDTH:
        return None
    if len(places) < DENSE * length:
        return None
    along = places @ _find_long_axis(hull)
    steps = ((along - along.min()) / STEP).astype(np.int64)
    tops = np.zeros(int(steps.max()) + 1)
    np.maximum.at(tops, steps, above)
    tops = np.maximum(tops[:-1], tops[1:])
    margin = round(LEAST_PART / STEP)
    inner = np.arange(margin, len(tops) - margin)
    roofs = np.array([min(tops[:place].max(), tops[place + 1 :].max()) for place in inner])
    if not len(inner) or not (tops[inner] < GAP_TOP * roofs).any():
        return None
    return steps <= inner[int(np.argmin(tops[inner] / roofs))]


def claim_insides(
    points: Float32[ndarray, "n 3"],
    clusters: Int32[ndarray, " n"],
    vehicles: Iterable[int],
    above: Float32[ndarray, " n"],
) -> Int32[ndarray, " n"]:
    """Give vehicles what lies above their footprints and below their tops: seats and dashboards, met through glass.

    Args:
        points: metres.
        clusters: number by point.
        vehicles: numbers of clusters that may be vehicles; those of another size claim nothing.
        above: metres above the ground.
    """
    claimed = clusters.copy()
    tree = KDTree(points[:, :2]) if len(points) else None
    for number in vehicles:
        own = np.flatnonzero(clusters == number)
        if tree is None or len(own) < 3 or above[own].max() > VEHICLE_TOP:
            continue
        hull = _compute_hull(points[own, :2].astype(float))
        length, width = _measure_hull(hull)
        if not (VEHICLE_WIDTH / 2 < length < VEHICLE_LENGTH and 0 < width < VEHICLE_WIDTH):
            continue
        near = np.array(tree.query_ball_point(hull.mean(axis=0), length), np.int64)
        inside = near[_is_within(points[near, :2].astype(float), hull) & (above[near] <= above[own].max() + HEADROOM)]
        claimed[inside] = number
    return claimed


def join_splinters(
    points: Float32[ndarray, "n 3"], clusters: Int32[ndarray, " n"], reach: Float32[ndarray, " n"]
) -> Int32[ndarray, " n"]:
    """Join small clusters to the larger neighbour that surrounds them most; clusters are renumbered from 0."""
    if len(points) < 2:
        return clusters
    count = int(clusters.max()) + 1
    sizes = np.bincount(clusters, minlength=count)
    low, high = (_reduce_by_cluster(points[:, :2], clusters, count, how) for how in (np.minimum, np.maximum))
    small = (high - low).max(axis=1) < SPLINTER
    rows = np.flatnonzero(small[clusters])
    neighbours = min(16, len(points))
    distances, near = KDTree(points).query(points[rows], neighbours)
    touching = (distances < reach[rows, None]) & (clusters[near] != clusters[rows, None])
    touching &= sizes[clusters[near]] > sizes[clusters[rows]][:, None]
    row, column = np.nonzero(touching)
    pairs = np.unique(np.stack([rows[row], clusters[np.asarray(near)[row, column]]]), axis=1)
    contacts = coo_matrix((np.ones(pairs.shape[1]), (clusters[pairs[0]], pairs[1])), shape=(count, count)).tocsr()
    best = np.asarray(contacts.argmax(axis=1)).ravel()
    share = np.asarray(contacts.max(axis=1).todense()).ravel() / np.maximum(sizes, 1)
    joins = np.flatnonzero(share > SURROUNDED)
    graph = coo_matrix((np.ones(len(joins), bool), (joins, best[joins])), shape=(count, count))
    return connected_components(graph, directed=False)[1].astype(np.int32)[clusters]


def _is_one_vehicle(
    points: Float32[ndarray, "n 3"],
    first: Int64[ndarray, " a"],
    second: Int64[ndarray, " b"],
    hull: Float64[ndarray, "h 2"],
    other: Float64[ndarray, "g 2"],
    above: Float32[ndarray, " n"],
) -> bool:
    """Whether a part belongs to the larger part `first`."""
    length, width = _measure_hull(_compute_hull(np.concatenate([hull, other])))
    if length > VEHICLE_LENGTH or width > VEHICLE_WIDTH:
        return False
    if _is_within(points[second, :2].astype(float), hull).mean() > INSIDE:
        return True
    if _is_standing(second, other, above):
        return False
    distance, _ = KDTree(points[first, :2]).query(points[second, :2], distance_upper_bound=GAP)
    return bool(np.isfinite(distance).any())


def _is_standing(part: Int64[ndarray, " a"], hull: Float64[ndarray, "h 2"], above: Float32[ndarray, " n"]) -> bool:
    heights = above[part]
    tall = heights.max() > STANDING_HEIGHT and heights.max() - heights.min() > 0.6 * STANDING_HEIGHT
    return bool(tall and _measure_hull(hull)[0] < STANDING_LENGTH)


def _compute_hull(places: Float64[ndarray, "n 2"]) -> Float64[ndarray, "h 2"]:
    """Corners of the convex hull, counterclockwise; the places themselves where they lie on a line."""
    if len(places) < 3:
        return places
    try:
        return places[ConvexHull(places).vertices]
    except QhullError:
        return places


def _measure_hull(hull: Float64[ndarray, "h 2"]) -> tuple[float, float]:
    """Length and width of the smallest of some rectangles around a hull."""
    axis = _find_long_axis(hull)
    return float(np.ptp(hull @ axis)), float(np.ptp(hull @ np.array([-axis[1], axis[0]])))


def _find_long_axis(hull: Float64[ndarray, "h 2"]) -> Float64[ndarray, "2"]:
    """The direction of the longer side of the smallest of some rectangles around a hull."""
    angles = np.radians(np.arange(0, 90, 5.0))
    axes = np.stack([np.cos(angles), np.sin(angles)])
    turned = np.stack([-axes[1], axes[0]])
    along, across = np.ptp(hull @ axes, axis=0), np.ptp(hull @ turned, axis=0)
    best = int(np.argmin((along + 0.1) * (across + 0.1)))
    return axes[:, best] if along[best] >= across[best] else turned[:, best]


def _is_within(places: Float64[ndarray, "n 2"], hull: Float64[ndarray, "h 2"]) -> Bool[ndarray, " n"]:
    """Whether places lie in a convex hull with its corners in counterclockwise order."""
    edges = np.roll(hull, -1, axis=0) - hull
    offsets = places[:, None] - hull[None]
    left = edges[:, 0] * offsets[..., 1] - edges[:, 1] * offsets[..., 0] >= -1e-9
    return np.asarray(left.all(axis=1))


def _reduce_by_cluster(
    values: Float32[ndarray, "n k"], clusters: Int32[ndarray, " n"], count: int, how: np.ufunc
) -> Float32[ndarray, "c k"]:
    """The least or largest values of each cluster."""
    found = np.full((count, values.shape[1]), np.inf if how is np.minimum else -np.inf, np.float32)
    how.at(found, clusters, values)
    return found
