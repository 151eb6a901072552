"""Fragments of one thing joined: glass cuts cars in pieces, and what was hidden for a while was followed twice."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.tracks.boxes import SLIM, classify_box
from instdrive_core.tracks.candidates import Cluster, make_cluster
from instdrive_core.tracks.nearest import align, nearest_distances, sample_evenly
from instdrive_core.tracks.range_images import Votes
from instdrive_core.tracks.seen_places import SEEN_THROUGH, UNSEEN, ask_sweep
from instdrive_core.tracks.solved_thing import SolvedThing, solve_thing
from instdrive_core.tracks.strict_test import is_mover
from instdrive_core.tracks.sweep_clouds import SweepCloud
from instdrive_core.tracks.trajectory import SPACING, Trajectory, even_knots

RIGID, VERY_RIGID = 0.45, 0.2
"""Metres (root mean square) by which parts of one thing may move against each other, and those that hardly do."""
GAP, WIDE_GAP, LORRY_GAP = 0.7, 2.0, 6.0
"""Metres between the points of such parts, of those that hardly move against each other, and of a lorry's two ends."""
CAR, LORRY, TALL = (5.8, 2.6), (18.0, 3.2), 2.3
"""Length and width in metres up to which parts are one thing, and for things higher than so many metres."""
TRIM = 0.3
"""Percent of the points on either side that do not count: a fragment may be small."""
MAX_HIDDEN = 1.6
"""Seconds for which a thing may be hidden between two fragments."""
DRIFT, DRIFT_PER_SECOND = 0.8, 1.5
"""Metres by which a fragment may lie off the place where the motion of the other leads."""
SPEED_CHANGE = 2.5
"""Metres per second squared by which it may have changed its velocity, plus 0.8 m/s."""
SLACK = 0.1
"""By how much the motion of the whole may explain its points worse than that of the parts."""
LOW, BELOW_TOP, LEVEL = 0.4, 0.2, 0.2
"""Metres above the ground, and below a thing's top, between which one looks whether parts hang together, and steps."""
ASKED, MOSTLY = 12, 0.7
"""Sweeps that are asked at most, and share that must see through at every height that is within sight."""
WHOLE, OUTGROWN = 10, 0.8
"""Sweeps that show all of a person, and metres by which another view of one may be longer."""
SHARED = 3
"""Sweeps that two fragments must share to be compared side by side."""


def merge_fragments(things: list[SolvedThing], clouds: list[SweepCloud], votes: list[Votes]) -> list[SolvedThing]:
    """The things with fragments of one object joined and solved again."""
    left = sorted(things, key=lambda thing: -thing.point_count)
    done: list[SolvedThing] = []
    while left:
        own = left.pop(0)
        tried: set[int] = set()
        while True:
            other = next((one for one in left if id(one) not in tried and may_be_one(own, one, clouds)), None)
            if other is None:
                break
            tried.add(id(other))
            whole = join(own, other, clouds, votes)
            if whole is not None:
                left.remove(other)
                own, tried = whole, set()
        done.append(own)
    return done


def may_be_one(first: SolvedThing, second: SolvedThing, clouds: list[SweepCloud]) -> bool:
    """Whether two things move as parts of one, or one as the other went on."""
    shared = sorted(set(first.sweeps) & set(second.sweeps))
    start = max(first.trajectory.start, second.trajectory.start)
    end = min(first.trajectory.end, second.trajectory.end)
    if len(shared) >= SHARED and end > start:
        return _move_alike(first, second, shared, start, end, clouds)
    earlier, later = sorted((first, second), key=lambda thing: thing.trajectory.start)
    return _goes_on(earlier.trajectory, later.trajectory) and may_measure_alike(first, second)


def may_measure_alike(first: SolvedThing, second: SolvedThing) -> bool:
    """Whether both may be views of one thing: what walked for long, and was seen whole, is no part of a car."""
    for one, other in ((first, second), (second, first)):
        size, height = measure(one)
        is_slim = classify_box(size, height)[0] in SLIM
        if is_slim and len(one.clusters) >= WHOLE and measure(other)[0].max() > size.max() + OUTGROWN:
            return False
    return True


def measure(thing: SolvedThing) -> tuple[Float64[ndarray, "2"], float]:
    """Extent of a thing's points along and across its heading, and the height of the highest, metres."""
    local = thing.local_points()
    low, high = np.percentile(local, 3, axis=0), np.percentile(local, 97, axis=0)
    return high[:2] - low[:2], float(high[2])


def _move_alike(
    first: SolvedThing, second: SolvedThing, shared: list[int], start: float, end: float, clouds: list[SweepCloud]
) -> bool:
    times = np.arange(start, end + 1e-6, SPACING)
    own, others = first.trajectory.poses_at(times), second.trajectory.poses_at(times)
    offset = into_frame(own, others[:, :2])
    rigidity = float(np.sqrt(np.mean(np.sum((offset - offset.mean(axis=0)) ** 2, axis=1))))
    if rigidity > RIGID:
        return False
    by_sweep = {one.sweep: one for one in first.clusters}
    theirs = {one.sweep: one for one in second.clusters}
    gaps = [
        float(nearest_distances(sample_evenly(by_sweep[k].points, 150), sample_evenly(theirs[k].points, 150)).min())
        for k in shared[:: max(1, len(shared) // 6)]
    ]
    limit = GAP
    if rigidity < VERY_RIGID:
        tops = [np.median([one.high[2] for one in thing.clusters]) for thing in (first, second)]
        limit = LORRY_GAP if min(tops) > TALL else WIDE_GAP
    if float(np.median(gaps)) >= limit:
        return False
    return not _are_apart([(by_sweep[k], theirs[k]) for k in shared], clouds)


def _are_apart(pairs: list[tuple[Cluster, Cluster]], clouds: list[SweepCloud]) -> bool:
    """Whether sweeps look through between two things from `LOW` to the top of the lower one: people who walk side by
    side. Of a car one sees the body there, or nothing."""
    tops = np.median([min(one.high[2], other.high[2]) for one, other in pairs])
    heights = np.arange(LOW, tops - BELOW_TOP, LEVEL)
    if not len(heights):
        return False
    asked, through = np.zeros(len(heights)), np.zeros(len(heights))
    for one, other in pairs[:: max(1, len(pairs) // ASKED)]:
        cloud = clouds[one.sweep]
        ground = float(cloud.heights[one.rows].mean())
        between = (_nearest_to(one, other) + _nearest_to(other, one)) / 2
        places = np.column_stack([np.repeat(between[None], len(heights), axis=0), heights + ground])
        for image in cloud.images:
            answers = ask_sweep(places, image)
            asked += answers != UNSEEN
            through += answers == SEEN_THROUGH
    known = asked >= SHARED
    return bool(known.mean() >= 0.5 and np.all(through[known] > MOSTLY * asked[known]))


def _nearest_to(one: Cluster, other: Cluster) -> Float64[ndarray, "2"]:
    """Where a cluster's points are nearest to another's middle, along the ground."""
    return one.points[np.linalg.norm(one.points[:, :2] - other.middle, axis=1).argmin(), :2].astype(float)


def _goes_on(earlier: Trajectory, later: Trajectory) -> bool:
    hidden = later.start - earlier.end
    if not -0.35 < hidden < MAX_HIDDEN:
        return False
    moments = np.array([earlier.end, later.start])
    ahead, back = earlier.poses_at(moments), later.poses_at(moments)
    off = min(np.linalg.norm(ahead[1, :2] - back[1, :2]), np.linalg.norm(ahead[0, :2] - back[0, :2]))
    velocity, other = earlier.velocities_at(moments[:1])[0], later.velocities_at(moments[1:])[0]
    change = float(np.linalg.norm(velocity - other))
    return bool(off < DRIFT + DRIFT_PER_SECOND * abs(hidden) and change < 0.8 + SPEED_CHANGE * max(abs(hidden), 0.3))


def join(first: SolvedThing, second: SolvedThing, clouds: list[SweepCloud], votes: list[Votes]) -> SolvedThing | None:
    """Both as one thing, solved again; None where that is too large, moves worse than its parts, or is no mover."""
    clusters = union(first.clusters, second.clusters, clouds, votes)
    whole = solve_thing(clusters, clouds, [joint_guess(first, second)])
    if whole is None:
        return None
    local = whole.local_points()
    extent = np.percentile(local, 100 - TRIM, axis=0) - np.percentile(local, TRIM, axis=0)
    length, width = LORRY if np.percentile(local[:, 2], 98) > TALL else CAR
    if extent[0] > length or extent[1] > width:
        return None
    if whole.ratio >= max(first.ratio, second.ratio, 0.3) + SLACK:
        return None
    whole = replace(whole, core_seen=max(first.core_seen, second.core_seen))
    return whole if is_mover(whole, clouds) else None


def union(first: list[Cluster], second: list[Cluster], clouds: list[SweepCloud], votes: list[Votes]) -> list[Cluster]:
    """The clusters of both, those of one sweep as one."""
    rows: dict[int, ndarray] = {one.sweep: one.rows for one in first}
    for one in second:
        rows[one.sweep] = np.unique(np.concatenate([rows.get(one.sweep, one.rows), one.rows]))
    return [make_cluster(clouds[k], votes[k].is_seen_through, rows[k], k) for k in sorted(rows)]


def joint_guess(first: SolvedThing, second: SolvedThing) -> Trajectory:
    """The trajectory of the larger of two fragments, where it does not reach that of the other, carried along."""
    own, other = first.trajectory, second.trajectory
    shift, turn = _offset(first, second)
    start, count = even_knots(np.array([own.start, own.end, other.start, other.end]))
    times = start + SPACING * np.arange(count)
    poses = own.poses_at(times)
    carried = other.poses_at(times)
    carried[:, 2] -= turn
    cosine, sine = np.cos(carried[:, 2]), np.sin(carried[:, 2])
    carried[:, 0] -= cosine * shift[0] - sine * shift[1]
    carried[:, 1] -= sine * shift[0] + cosine * shift[1]
    within = (times >= own.start - 1e-6) & (times <= own.end + 1e-6)
    theirs = ~within & (times >= other.start - 1e-6) & (times <= other.end + 1e-6)
    poses[theirs] = carried[theirs]
    known = within | theirs
    for axis in range(3):
        poses[~known, axis] = np.interp(times[~known], times[known], poses[known, axis])
    return Trajectory(start, poses)


def _offset(first: SolvedThing, second: SolvedThing) -> tuple[Float64[ndarray, "2"], float]:
    """Where the origin of the second is in the first's frame, and how it is turned there."""
    start = max(first.trajectory.start, second.trajectory.start)
    end = min(first.trajectory.end, second.trajectory.end)
    times = np.linspace(start, end, 8) if end > start else np.array([(start + end) / 2])
    own, others = first.trajectory.poses_at(times), second.trajectory.poses_at(times)
    turn = np.angle(np.exp(1j * (others[:, 2] - own[:, 2])).mean())
    shift = into_frame(own, others[:, :2]).mean(axis=0)
    if end <= start:
        # Nothing shows how they lie but that their points must coincide.
        shift, turn = _settle_merges(first, second, shift), 0.0
    return shift, float(turn)


def _settle_merges(first: SolvedThing, second: SolvedThing, shift: Float64[ndarray, "2"]) -> Float64[ndarray, "2"]:
    own = sample_evenly(first.local_points().astype(np.float32), 300)
    other = sample_evenly(second.local_points().astype(np.float32), 300)
    return align(other, own, shift)[0]


def into_frame(poses: Float64[ndarray, "t 3"], places: Float64[ndarray, "t 2"]) -> Float64[ndarray, "t 2"]:
    """Places in the frames of poses, one each: along the heading and to the left, metres."""
    offset = places - poses[:, :2]
    cosine, sine = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    return np.column_stack([cosine * offset[:, 0] + sine * offset[:, 1], cosine * offset[:, 1] - sine * offset[:, 0]])
