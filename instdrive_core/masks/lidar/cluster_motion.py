"""Motion of things: one cluster found again in the sweeps before and after."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from jaxtyping import Float32, Float64
from numpy import ndarray
from scipy.optimize import linear_sum_assignment
from scipy.spatial import KDTree

from instdrive_core.masks.lidar.clusters import thin_rows

MAX_SPEED = 30.0
"""Metres per second."""
MIN_SPEED = 1.0
"""Metres per second below which what moves is not looked for in other sweeps."""
MAX_GAP = 0.45
"""Seconds between sweeps up to which clusters are looked for in the other one."""
SIZE_WEIGHT = 1.5
"""Metres of displacement that a metre of difference in size is as unlikely as."""
MAX_COST = 6.0
MAX_DEVIATION, MAX_GROWTH = 1.0, 2.0
"""Metres that a cluster may lie off the place its motion leads to, and differ in size, to be the same thing."""
ALIGNMENTS = 8
"""Steps of closest points that settle a displacement."""
ALIGNED_POINTS = 400
ALIGNED_SHARE = 0.7
"""Share of the points, the closest ones, that each step uses."""
LINKS = 2
"""Sweeps before and after whose points complete a thing."""
SPACING = 0.06
"""Metres: a thing's points are thinned to one per cell of this size."""


@dataclass(frozen=True)
class MovingCluster:
    """A moving thing as one sweep saw it."""

    id: int
    points: Float32[ndarray, "k 3"]
    velocity: Float64[ndarray, "3"]
    """Metres per second."""


@dataclass(frozen=True)
class Link:
    """One thing in two sweeps that follow each other."""

    first: int
    second: int
    """Positions among the clusters of the earlier and the later sweep."""
    shift: Float64[ndarray, "3"]
    """Metres from the first to the second."""


def link_clusters(
    earlier: list[Float32[ndarray, "_ 3"]], later: list[Float32[ndarray, "_ 3"]], gap: float
) -> list[Link]:
    """Link clusters of two sweeps that are the same thing, at most one of each; `gap` is in seconds."""
    if not earlier or not later or gap > MAX_GAP:
        return []
    shift, growth = _compare_boxes(earlier, later)
    distance = np.linalg.norm(shift[..., :2], axis=2)
    cost = distance + SIZE_WEIGHT * np.abs(growth).sum(axis=2) + 2 * np.abs(shift[..., 2])
    cost[distance > MAX_SPEED * gap] = np.inf
    pairs = zip(*linear_sum_assignment(np.minimum(cost, 2 * MAX_COST)), strict=True)
    return [
        Link(int(a), int(b), align_clusters(earlier[a], later[b], shift[a, b]))
        for a, b in pairs
        if cost[a, b] < MAX_COST
    ]


def find_again(
    moving: Float32[ndarray, "k 3"],
    velocity: Float64[ndarray, "3"],
    others: list[Float32[ndarray, "_ 3"]],
    gap: float,
) -> int | None:
    """Find the cluster of another sweep that a moving one is after `gap` seconds (negative: before); None = none."""
    if not others or abs(gap) > MAX_GAP or np.linalg.norm(velocity) < MIN_SPEED:
        return None
    shift, growth = _compare_boxes([moving], others)
    off = np.linalg.norm(shift[0, :, :2] - velocity[:2] * gap, axis=1)
    best = int(np.argmin(off + np.abs(growth[0]).sum(axis=1)))
    fits = off[best] < MAX_DEVIATION and np.abs(growth[0, best]).sum() < MAX_GROWTH
    return best if fits else None


def align_clusters(
    first: Float32[ndarray, "a 3"], second: Float32[ndarray, "b 3"], shift: Float64[ndarray, "3"]
) -> Float64[ndarray, "3"]:
    """Refine a first guess of the displacement along the ground that brings one cluster onto the other."""
    tree = KDTree(second)
    sample = first[:: max(1, len(first) // ALIGNED_POINTS)].astype(float)
    shift = np.array([shift[0], shift[1], 0.0])
    for _ in range(ALIGNMENTS):
        distances, nearest = tree.query(sample + shift)
        used = distances <= np.quantile(distances, ALIGNED_SHARE)
        step = (second[np.asarray(nearest)[used]] - sample[used] - shift).mean(axis=0)
        shift[:2] += step[:2]
        if np.abs(step[:2]).max() < 0.01:
            break
    return shift


def complete_clusters(by_time: dict[float, list[MovingCluster]]) -> dict[float, list[MovingCluster]]:
    """Complete clusters with their mean velocity from the sweep before and to the one after (0 where neither shows
    them), and with the points that the sweeps around saw of them."""
    times = sorted(by_time)
    forward: list[dict[int, Link]] = []
    for earlier, later in pairwise(times):
        links = link_clusters(_list_points(by_time[earlier]), _list_points(by_time[later]), later - earlier)
        forward.append({link.first: link for link in links})
    backward = [{link.second: link for link in links.values()} for links in forward]
    result: dict[float, list[MovingCluster]] = {}
    for step, time in enumerate(times):
        result[time] = []
        for position, one in enumerate(by_time[time]):
            speeds = []
            if step < len(forward) and position in forward[step]:
                speeds.append(forward[step][position].shift / (times[step + 1] - time))
            if step > 0 and position in backward[step - 1]:
                speeds.append(backward[step - 1][position].shift / (time - times[step - 1]))
            velocity = np.mean(speeds, axis=0) if speeds else np.zeros(3)
            points = np.concatenate(
                [one.points, *_gather_neighbouring_points(by_time, times, forward, backward, step, position)]
            )
            result[time].append(replace(one, points=points[thin_rows(points, SPACING)], velocity=velocity))
    return result


def _gather_neighbouring_points(
    by_time: dict[float, list[MovingCluster]],
    times: list[float],
    forward: list[dict[int, Link]],
    backward: list[dict[int, Link]],
    step: int,
    position: int,
) -> list[Float32[ndarray, "_ 3"]]:
    """Gather points of the same thing in the next sweeps in both directions, brought to where it is in this one."""
    parts = []
    for direction in (1, -1):
        at, here, shift = step, position, np.zeros(3)
        for _ in range(LINKS):
            links = forward[at] if direction == 1 and at < len(forward) else {}
            if direction == -1 and at > 0:
                links = backward[at - 1]
            if here not in links:
                break
            link = links[here]
            shift += direction * link.shift
            at, here = at + direction, link.second if direction == 1 else link.first
            parts.append((by_time[times[at]][here].points - shift).astype(np.float32))
    return parts


def _list_points(clusters: list[MovingCluster]) -> list[Float32[ndarray, "_ 3"]]:
    return [one.points for one in clusters]


def _compare_boxes(
    earlier: list[Float32[ndarray, "_ 3"]], later: list[Float32[ndarray, "_ 3"]]
) -> tuple[Float64[ndarray, "a b 3"], Float64[ndarray, "a b 3"]]:
    """Compute how middle and size of the boxes around each pair of clusters differ."""
    lows, highs = (np.array([how(part, axis=0) for part in earlier], float) for how in (np.min, np.max))
    others_low, others_high = (np.array([how(part, axis=0) for part in later], float) for how in (np.min, np.max))
    shift = (others_low + others_high)[None] / 2 - (lows + highs)[:, None] / 2
    return shift, (others_high - others_low)[None] - (highs - lows)[:, None]
