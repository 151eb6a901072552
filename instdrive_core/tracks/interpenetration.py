"""No two things are in one place: of boxes that stand in each other step after step, one is a piece of the other, and
what lies in one and later in another was followed wrongly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.tracks.boxes import TrackBox
from instdrive_core.tracks.candidates import Cluster
from instdrive_core.tracks.fragments import into_frame, join, may_be_one, may_measure_alike
from instdrive_core.tracks.motion_tests import MIN_SWEEPS
from instdrive_core.tracks.range_images import Votes
from instdrive_core.tracks.solved_thing import SolvedThing, solve_thing
from instdrive_core.tracks.strict_test import is_mover
from instdrive_core.tracks.sweep_clouds import SweepCloud
from instdrive_core.tracks.trajectory import SPACING

INSIDE, OFTEN = 0.2, 0.5
"""Share of the smaller box's area that lies in the other, and share of their common sweeps, from which on two things
are one: lengths that were guessed overlap less."""
SHARED = 3
"""Sweeps that show both at least."""
OWNED, EDGE = 0.6, 0.2
"""Share of a cluster's points that lie in another thing's box, grown by so many metres, if they are of that thing, and
share of a thing's sweeps from which on none of it is its own."""
GRID = 8
"""Places along either side of a box by which its area is compared."""
COVERED = 0.5
"""Share of a thing's points that are others' as well from which on it is one with the other that has most of them."""


def join_covered(things: list[SolvedThing], clouds: list[SweepCloud], votes: list[Votes]) -> list[SolvedThing]:
    """The things, those most of whose points are a larger one's joined with it: of what passes by, the front is
    followed first, and then the rear."""
    kept: list[SolvedThing] = []
    for thing in sorted(things, key=lambda one: -one.point_count):
        shared = [_count_shared_points(thing, other) for other in kept]
        if sum(shared) <= COVERED * thing.point_count:
            kept.append(thing)
            continue
        most = int(np.argmax(shared))
        if not set(thing.sweeps) <= set(kept[most].sweeps):
            kept[most : most + 1] = _unite(kept[most], thing, clouds, votes)
    return kept


def _count_shared_points(thing: SolvedThing, other: SolvedThing) -> int:
    theirs = {one.sweep: one.rows for one in other.clusters}
    return sum(int(np.isin(one.rows, theirs[one.sweep]).sum()) for one in thing.clusters if one.sweep in theirs)


def resolve_overlaps(things: list[SolvedThing], clouds: list[SweepCloud], votes: list[Votes]) -> list[SolvedThing]:
    """The things, each pair that would stand in each other joined."""
    kept: list[SolvedThing] = []
    for thing in sorted(things, key=lambda one: -one.point_count):
        within = next((number for number, other in enumerate(kept) if stand_in_each_other(thing, other, clouds)), None)
        if within is None:
            kept.append(thing)
        else:
            kept[within : within + 1] = _unite(kept[within], thing, clouds, votes)
    return kept


def _unite(
    larger: SolvedThing, smaller: SolvedThing, clouds: list[SweepCloud], votes: list[Votes]
) -> list[SolvedThing]:
    """Two things in one place as one. Where they cannot be joined, the one of which more was met is kept, and of the
    other what it alone knows: where it was before and after."""
    whole = join(larger, smaller, clouds, votes)
    if whole is not None:
        return [whole]
    first, last = min(larger.sweeps), max(larger.sweeps)
    rests: list[SolvedThing] = []
    for clusters in (
        [one for one in smaller.clusters if one.sweep < first],
        [one for one in smaller.clusters if one.sweep > last],
    ):
        rest = _solve_rest(smaller, clusters, clouds)
        if rest is None:
            continue
        goes_on = may_measure_alike(larger, smaller) and may_be_one(larger, rest, clouds)
        whole = join(larger, rest, clouds, votes) if goes_on else None
        if whole is not None:
            larger = whole
        elif is_mover(rest, clouds):
            rests.append(rest)
    return [larger, *rests]


def _solve_rest(thing: SolvedThing, clusters: list[Cluster], clouds: list[SweepCloud]) -> SolvedThing | None:
    """A thing in some of its sweeps, solved again; None where these are too few."""
    if len(clusters) < MIN_SWEEPS:
        return None
    rest = solve_thing(clusters, clouds, [thing.trajectory])
    return None if rest is None else replace(rest, core_seen=thing.core_seen)


def drop_swapped(things: list[SolvedThing], clouds: list[SweepCloud]) -> list[SolvedThing]:
    """The things without those that were followed from one of the others to the next: in some sweeps their points lie
    in the one's box, in later ones in the next one's."""
    boxes = [thing.box(clouds) for thing in things]
    return [thing for number, thing in enumerate(things) if not _is_swapped(number, things, boxes)]


def _is_swapped(number: int, things: list[SolvedThing], boxes: list[TrackBox]) -> bool:
    clusters = things[number].clusters
    owned: dict[int, int] = {}
    for one in clusters:
        shares = [
            0.0 if other == number else _share_inside(one, thing, box)
            for other, (thing, box) in enumerate(zip(things, boxes, strict=True))
        ]
        owner = int(np.argmax(shares))
        if shares[owner] > OWNED:
            owned[owner] = owned.get(owner, 0) + 1
    lasting = [count for count in owned.values() if count >= SHARED]
    return len(lasting) >= 2 and sum(lasting) > OWNED * len(clusters)


def _share_inside(cluster: Cluster, thing: SolvedThing, box: TrackBox) -> float:
    """Share of a cluster's points that lie in a thing's box, 0 where that is not followed."""
    if not thing.trajectory.start - SPACING <= cluster.time <= thing.trajectory.end + SPACING:
        return 0.0
    pose = thing.trajectory.poses_at(np.array([cluster.time]))
    local = into_frame(np.repeat(pose, len(cluster.points), axis=0), cluster.points[:, :2].astype(float))
    half = np.array([box.length, box.width]) / 2 + EDGE
    return float(np.mean(np.all(np.abs(local - box.center) <= half, axis=1)))


def stand_in_each_other(first: SolvedThing, second: SolvedThing, clouds: list[SweepCloud]) -> bool:
    """Whether the boxes of two things overlap in most of the sweeps that show both."""
    shared = sorted(set(first.sweeps) & set(second.sweeps))
    if len(shared) < SHARED:
        return False
    boxes = first.box(clouds), second.box(clouds)
    small, large = sorted(zip((first, second), boxes, strict=True), key=lambda one: one[1].length * one[1].width)
    times = np.array([clouds[sweep].time for sweep in shared])
    inside = _measure_overlaps(
        small[1], small[0].trajectory.poses_at(times), large[1], large[0].trajectory.poses_at(times)
    )
    return bool(np.mean(inside >= INSIDE) > OFTEN)


def _measure_overlaps(
    small: TrackBox, poses: Float64[ndarray, "t 3"], large: TrackBox, others: Float64[ndarray, "t 3"]
) -> Float64[ndarray, " t"]:
    """Share of one box's area that lies in another, at each moment."""
    steps = (np.arange(GRID) + 0.5) / GRID - 0.5
    along, across = np.meshgrid(steps * small.length + small.center[0], steps * small.width + small.center[1])
    cosine, sine = np.cos(poses[:, 2, None]), np.sin(poses[:, 2, None])
    x = poses[:, 0, None] + cosine * along.ravel() - sine * across.ravel()
    y = poses[:, 1, None] + sine * along.ravel() + cosine * across.ravel()
    places = np.stack([x, y], axis=2).reshape(-1, 2)
    local = into_frame(np.repeat(others, GRID * GRID, axis=0), places)
    half = np.array([large.length, large.width]) / 2
    is_inside = np.all(np.abs(local - large.center) <= half, axis=1)
    return is_inside.reshape(len(poses), -1).mean(axis=1)
