"""People who walk side by side and were followed as one, parted."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float64
from numpy import ndarray

from instdrive_core.tracks.boxes import PERSON_HEIGHTS, looks_like_person
from instdrive_core.tracks.candidates import MIN_POINTS, Cluster, make_cluster
from instdrive_core.tracks.range_images import Votes
from instdrive_core.tracks.second_pass import REACHES
from instdrive_core.tracks.solved_thing import SolvedThing, solve_thing
from instdrive_core.tracks.strict_test import is_mover
from instdrive_core.tracks.sweep_clouds import SweepCloud

WIDEST = 2.6
"""Metres that some people side by side measure at most."""
SHORTEST = 1.1
"""Metres: whoever is smaller may be a pram, a bag or a dog that goes along with somebody."""
NARROWEST = 0.7
"""Metres that two people side by side measure at least."""
KNEE = 0.6
"""Metres above the ground: what begins higher up is a strip of a car over the roofs of others, not somebody."""
CELL, VALLEY = 0.1, 0.3
"""Metres along the line through two people by which points are counted, two cells at a time, and share of what is
counted where either of them is densest that the gap between them may hold."""
CORE, STRIPED = 10, 0.5
"""Percent of the points on either side of somebody that do not count, and share of the fewest points counted in between
which the gap may hold: beams far apart draw stripes with nothing in between on all that they meet."""
ROUNDS = 4


def part_abreast(thing: SolvedThing, clouds: list[SweepCloud], votes: list[Votes]) -> list[SolvedThing]:
    """The people that a thing is made of, each by itself; the thing alone where it is no group of people.

    Two are parted where both measure like people, stand upright and move, and hardly a point was met between them.
    """
    local = thing.lasting_points()
    size = np.ptp(np.percentile(local[:, :2], [1, 99], axis=0), axis=0)
    if not NARROWEST < size.max() < WIDEST or np.percentile(local[:, 2], 99) > PERSON_HEIGHTS[1]:
        return [thing]
    axis, gap = _find_gap(local[:, :2])
    if gap is None:
        return [thing]
    sides = [_side_of(one, thing, axis) > gap for one in thing.clusters]
    halves = []
    for beyond in (False, True):
        clusters = _select_side(thing, sides, beyond, clouds, votes)
        half = solve_thing(clusters, clouds, [thing.trajectory], REACHES) if len(clusters) >= 3 else None
        if half is None or not _is_person(half) or not is_mover(half, clouds):
            return [thing]
        halves.append(half)
    return [part for half in halves for part in part_abreast(half, clouds, votes)]


def _find_gap(places: Float64[ndarray, "n 2"]) -> tuple[Float64[ndarray, "2"], float | None]:
    """The direction in which places spread most, and where along it is a gap between two; None where there is none."""
    axis = np.linalg.eigh(np.cov(places.T))[1][:, 1]
    along = places @ axis
    first, second = np.percentile(along, [1, 99])
    for _ in range(ROUNDS):
        middle = (first + second) / 2
        first, second = along[along <= middle].mean(), along[along > middle].mean()
    edges = np.arange(along.min(), along.max() + 2 * CELL, CELL)
    counts = np.convolve(np.histogram(along, edges)[0], [1, 1], "valid")
    centers = edges[1:-1]
    between = np.flatnonzero((centers > first) & (centers < second))
    if not len(between):
        return axis, None
    lowest = counts[between].min()
    gap = float(centers[between[counts[between] == lowest]].mean())
    for side in (along <= gap, along > gap):
        begin, end = np.percentile(along[side], [CORE, 100 - CORE])
        core = counts[(centers >= begin) & (centers <= end)]
        if not len(core) or lowest >= VALLEY * core.max() or lowest >= STRIPED * core.min():
            return axis, None
    return axis, gap


def _side_of(cluster: Cluster, thing: SolvedThing, axis: Float64[ndarray, "2"]) -> Float64[ndarray, " k"]:
    """How far along an axis of a thing's frame the points of one of its clusters lie, metres."""
    x, y, yaw = thing.trajectory.poses_at(np.array([cluster.time]))[0]
    cosine, sine = np.cos(yaw), np.sin(yaw)
    in_world = np.array([cosine * axis[0] - sine * axis[1], sine * axis[0] + cosine * axis[1]])
    return (cluster.points[:, :2] - np.array([x, y])) @ in_world


def _select_side(
    thing: SolvedThing,
    sides: list[Bool[ndarray, " k"]],
    beyond: bool,
    clouds: list[SweepCloud],
    votes: list[Votes],
) -> list[Cluster]:
    """The clusters of what lies on one side, in the sweeps that show enough of it."""
    chosen = [(one.sweep, one.rows[side == beyond]) for one, side in zip(thing.clusters, sides, strict=True)]
    return [make_cluster(clouds[k], votes[k].is_seen_through, rows, k) for k, rows in chosen if len(rows) >= MIN_POINTS]


def _is_person(thing: SolvedThing) -> bool:
    local = thing.lasting_points()
    low, high = np.percentile(local[:, 2], [2, 98])
    return looks_like_person(local) and bool(low < KNEE and high > SHORTEST)
