"""Whether a thing leaves the places where it was met: sweeps from when it had gone on look through them.

Of a creeping car, most points look as if they stood: its flanks slide along themselves. Its ends do not, and what a
sweep sees beyond them contradicts standing. What is hidden and uncovered by others, or seen in part now and then, seems
to move, too, but nobody ever looks through a place that it is said to have left.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64, UInt8
from numpy import ndarray

from instdrive_core.tracks.candidates import Cluster
from instdrive_core.tracks.motion_tests import carry
from instdrive_core.tracks.nearest import sample_rows
from instdrive_core.tracks.seen_places import MET, SEEN_THROUGH, UNSEEN, ask_sweep
from instdrive_core.tracks.solved_thing import SolvedThing
from instdrive_core.tracks.sweep_clouds import SweepCloud
from instdrive_core.tracks.trajectory import Trajectory

APART = 0.5
"""Metres of travel between two sweeps that are compared."""
COMPARED, SAMPLE = 40, 80
"""Pairs of sweeps that are compared at most, and points of each."""
MIN_SEEN = 30
"""Points of all pairs that must be within sight whether the thing moves or stands: fewer prove nothing."""
VACATED, CONTRADICTED = 0.02, 1 / 3
"""Share of these that must be seen through where the thing would stand; what is seen through where it should have moved
to is at most so much of it."""
RING, DRIFT_SHARE = 0.35, 0.5
"""Metres from the lowest to the highest point of what may be a ring in most sweeps, and share of its way by which it
must come nearer to the recording car, or fall back, to be none."""
EGO_WAY = 0.6
"""Metres that the recording car must go for rings to move."""


def vacates(thing: SolvedThing, clouds: list[SweepCloud]) -> bool:
    """Whether a solved thing's motion is proved by the places it left."""
    if may_be_ring(thing, clouds):
        return False
    left, missing, meets_more = _judge(thing.clusters, thing.trajectory, clouds)
    return left >= VACATED and missing <= CONTRADICTED * left and meets_more


def may_be_ring(thing: SolvedThing, clouds: list[SweepCloud]) -> bool:
    """Whether a thing is flat and goes along with the recording car: so does the ring that a beam draws on roofs and
    hoods, which are level and stand. Nobody meets such a ring where it was before."""
    if np.median([one.high[2] - one.low[2] for one in thing.clusters]) >= RING:
        return False
    places = thing.trajectory.poses_at(np.array([one.time for one in thing.clusters]))[:, :2]
    ego = np.array([clouds[one.sweep].position[:2] for one in thing.clusters])
    way, of_ego, against_it = (float(np.linalg.norm(np.ptp(one, axis=0))) for one in (places, ego, places - ego))
    return of_ego >= EGO_WAY and against_it < DRIFT_SHARE * way


def may_vacate(clusters: list[Cluster], guess: Trajectory, clouds: list[SweepCloud]) -> bool:
    """Whether clusters may be proved to move as a first guess says: somebody looks through where they were.

    Half of what proves it is enough, as guesses are rough.
    """
    return _judge(clusters, guess, clouds)[0] >= VACATED / 2


def _judge(clusters: list[Cluster], trajectory: Trajectory, clouds: list[SweepCloud]) -> tuple[float, float, bool]:
    """Shares of places that are seen through where the clusters would stand and where they should have moved to, and
    whether more are met if they move; 0, 0 where too few are within sight."""
    answers = _compare(clusters, trajectory, clouds)
    stands, moves = answers[:, 0], answers[:, 1]
    seen = (stands != UNSEEN) & (moves != UNSEEN)
    if seen.sum() < MIN_SEEN:
        return 0.0, 0.0, False
    left, missing = (float(np.mean(one[seen] == SEEN_THROUGH)) for one in (stands, moves))
    return left, missing, bool(np.count_nonzero(moves[seen] == MET) > np.count_nonzero(stands[seen] == MET))


def _compare(clusters: list[Cluster], trajectory: Trajectory, clouds: list[SweepCloud]) -> UInt8[ndarray, "p 2"]:
    """What sweeps say of the points of other sweeps, left where they were met and carried along."""
    poses = trajectory.poses_at(np.array([one.time for one in clusters]))
    apart = np.linalg.norm(poses[:, None, :2] - poses[None, :, :2], axis=2)
    first, second = np.nonzero(apart >= APART)
    # The nearer in time the better: things turn other sides to the sensor on their way.
    order = np.argsort(np.abs(first - second), kind="stable")
    chosen = order[:: max(1, -(-len(order) // COMPARED))]
    found = [np.zeros((0, 2), np.uint8)]
    for here, there in zip(first[chosen].tolist(), second[chosen].tolist(), strict=True):
        cloud = clouds[clusters[here].sweep]
        rows = sample_rows(clusters[here].rows, SAMPLE)
        stands = cloud.points[rows]
        moves = carry(stands, poses[here, :2], poses[here, 2], poses[there, :2], poses[there, 2])
        for image in clouds[clusters[there].sweep].images:
            answers = [ask_sweep(_in_world(points, cloud.heights[rows]), image) for points in (stands, moves)]
            found.append(np.column_stack(answers))
    return np.concatenate(found)


def _in_world(points: ndarray, heights: ndarray) -> Float64[ndarray, "n 3"]:
    """Points whose z is above the ground, in the world."""
    places = points.astype(np.float64)
    places[:, 2] += heights
    return places
