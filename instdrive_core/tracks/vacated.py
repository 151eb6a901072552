"""Whether a thing leaves the places where it was met: sweeps from when it had gone on look through them.

Of a creeping car, most points look as if they stood: its flanks slide along themselves. Its ends do not, and what a
sweep sees beyond them contradicts standing. What is hidden and uncovered by others, or seen in part now and then, seems
to move, too, but nobody ever looks through a place that it is said to have left.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.tracks.motion_tests import carry
from instdrive_core.tracks.nearest import sample_evenly
from instdrive_core.tracks.seen_places import MET, SEEN_THROUGH, UNSEEN, look_at
from instdrive_core.tracks.solved_thing import SolvedThing
from instdrive_core.tracks.sweep_clouds import SweepCloud

APART = 0.5
"""Metres of travel between two sweeps that are compared."""
COMPARED, SAMPLE = 40, 80
"""Pairs of sweeps that are compared at most, and points of each."""
MIN_SEEN = 30
"""Points of all pairs that must be within sight whether the thing moves or stands: fewer prove nothing."""
VACATED, CONTRADICTED = 0.02, 1 / 3
"""Share of these that must be seen through where the thing would stand; what is seen through where it should have moved
to is at most so much of it."""


def vacates(thing: SolvedThing, clouds: list[SweepCloud]) -> bool:
    """Whether a solved thing's motion is proved by the places it left."""
    answers = _compare(thing, clouds)
    stands, moves = answers[:, 0], answers[:, 1]
    seen = (stands != UNSEEN) & (moves != UNSEEN)
    if seen.sum() < MIN_SEEN:
        return False
    left = float(np.mean(stands[seen] == SEEN_THROUGH))
    missing = float(np.mean(moves[seen] == SEEN_THROUGH))
    meets_more = np.count_nonzero(moves[seen] == MET) > np.count_nonzero(stands[seen] == MET)
    return left >= VACATED and missing <= CONTRADICTED * left and bool(meets_more)


def _compare(thing: SolvedThing, clouds: list[SweepCloud]) -> ndarray:
    """What sweeps say of the thing's points of other sweeps, left where they were met and carried along: [p, 2]."""
    poses = thing.trajectory.poses_at(np.array([one.time for one in thing.clusters]))
    apart = np.linalg.norm(poses[:, None, :2] - poses[None, :, :2], axis=2)
    first, second = np.nonzero(apart >= APART)
    # The nearer in time the better: things turn other sides to the sensor on their way.
    order = np.argsort(np.abs(first - second), kind="stable")
    chosen = order[:: max(1, -(-len(order) // COMPARED))]
    found = [np.zeros((0, 2), np.uint8)]
    for here, there in zip(first[chosen].tolist(), second[chosen].tolist(), strict=True):
        cluster = thing.clusters[here]
        cloud = clouds[cluster.sweep]
        rows = cluster.rows[(np.arange(min(SAMPLE, len(cluster.rows))) * len(cluster.rows)) // min(SAMPLE, len(cluster.rows))]
        stands = cloud.points[rows]
        moves = carry(stands, poses[here, :2], poses[here, 2], poses[there, :2], poses[there, 2])
        for image in clouds[thing.clusters[there].sweep].images:
            answers = [look_at(_in_world(points, cloud.heights[rows]), image) for points in (stands, moves)]
            found.append(np.column_stack(answers))
    return np.concatenate(found)


def _in_world(points: ndarray, heights: ndarray) -> Float64[ndarray, "n 3"]:
    """Points whose z is above the ground, in the world."""
    places = points.astype(np.float64)
    places[:, 2] += heights
    return places
