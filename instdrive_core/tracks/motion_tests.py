"""Whether a followed thing really moves: its points coincide when its motion is taken off, and not otherwise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.tracks.linking import Chain
from instdrive_core.tracks.nearest import nearest_distances, sample_evenly
from instdrive_core.tracks.observations import Observation
from instdrive_core.tracks.starts import gather_linked_places, middles, smooth
from instdrive_core.tracks.sweep_clouds import SweepCloud
from instdrive_core.tracks.trajectory import Trajectory

MIN_SWEEPS = 5
SHORTEST_CUT, TURN = 10, 8
"""Sweeps of the pieces that a chain is cut into, at least, and those before and after a cut that its motion is judged
by."""
REVERSED, SUDDEN = 0.7, 2.5
"""Metres per second with which a thing goes there and back if these are two that met, and seconds around a cut that
tell it: given longer, people do turn round."""
JUMP, NEAR_LINKS = 0.8, 3
"""Metres by which a chain goes on beside the place where its last and its next links lead, at a jump from one thing to
another, and how many of these links are asked."""
MIN_WAY = 1.0
"""Metres of travel."""
MIN_STRAIGHTNESS = 0.6
"""Net way as a share of the path."""
MAX_ROUGHNESS, ROUGHNESS_SHARE = 0.3, 0.015
"""Metres (root mean square) that places may lie off an even motion, and share of the speed in metres per second."""
EGO_REACH, EGO_DRIFT, EGO_SHARE = 4.0, 0.5, 80
"""Metres: what stays within so many of the sensor and moves against it by no more is part of the recording car. Percent
of the sweeps in which it must: now and then, one sees a part of it only."""
EGO_HALF_WIDTH = 1.6
"""Metres to either side within which the recording car's parts lie; cars in the next lane are farther off."""
EGO_STEP = 0.5
"""Metres that the recording car must travel to tell where it is headed."""
LOOSE_RATIO = 0.75
SURE_SEEN = 0.5
"""Share of points at places seen through from which on a chain need only go somewhere: it was cut out roughly."""
CLIP = 0.6
"""Metres beyond which a distance between clouds counts no more."""
APART = 1.0
"""Metres of travel between clouds that are compared."""
COMPARED = 24
"""Pairs of clouds that are compared at most."""
SAMPLE = 100


def may_move(chain: Chain, clouds: list[SweepCloud]) -> bool:
    """The loose test: a chain's motion is even, goes somewhere, and explains its points."""
    if len(chain.clusters) < MIN_SWEEPS:
        return False
    times = np.array([one.time for one in chain.clusters])
    is_seen_through = np.mean([one.seen_through for one in chain.clusters]) > SURE_SEEN
    passed = False
    for places in (gather_linked_places(chain), middles(chain)):
        way = float(np.linalg.norm(places[-1] - places[0]))
        path_of = smooth(times, places)
        knots = path_of.knots[:, :2]
        path = float(np.linalg.norm(np.diff(knots, axis=0), axis=1).sum())
        if max(way, path_of.farthest_way()) < MIN_WAY or path_of.farthest_way() < MIN_STRAIGHTNESS * path:
            continue
        off = np.linalg.norm(path_of.poses_at(times)[:, :2] - places, axis=1)
        speed = path / max(times[-1] - times[0], 0.1)
        slack = 2 if is_seen_through else 1
        if np.sqrt(np.mean(off**2)) > slack * (MAX_ROUGHNESS + ROUGHNESS_SHARE * speed):
            continue
        if moves_with_ego(places, clouds, [one.sweep for one in chain.clusters]):
            return False
        parts = [one.points for one in chain.clusters]
        shifts = path_of.poses_at(times)[:, :2]
        if is_seen_through or motion_ratio(parts, shifts) < LOOSE_RATIO:
            passed = True
            break
    return passed


def cut_to_movers(chain: Chain, clouds: list[SweepCloud]) -> list[Chain]:
    """The chain if it may move, else its parts that may. It is cut where it jumps to something else, then where its
    motion changes most: in a long drive what is followed turns back or waits. Two that met and were taken for each
    other are cut in any case."""
    turn = _find_turn(chain)
    if not turn.reverses and may_move(chain, clouds):
        return [chain]
    cut = turn.position if turn.reverses else _find_jump(chain) or turn.position
    if not cut:
        return []
    first = Chain(chain.clusters[:cut], chain.shifts[: cut - 1], chain.velocity)
    second = Chain(chain.clusters[cut:], chain.shifts[cut:], chain.velocity)
    return [part for half in (first, second) for part in cut_to_movers(half, clouds)]


@dataclass(frozen=True)
class _Turn:
    """Where a chain's velocity changes most."""

    position: int
    """Number of the cluster before which it does; 0 where the chain is too short to be cut."""
    reverses: bool
    """Whether it goes back at once where it came from, faster than anything can turn round."""


def _find_turn(chain: Chain) -> _Turn:
    places, times = middles(chain), np.array([one.time for one in chain.clusters])
    positions = np.arange(SHORTEST_CUT, len(places) - SHORTEST_CUT)
    if not len(positions):
        return _Turn(0, False)
    before, after = (
        (places[last] - places[first]) / (times[last] - times[first])[:, None]
        for first, last in ((positions - TURN, positions), (positions, positions + TURN))
    )
    most = int(np.linalg.norm(after - before, axis=1).argmax())
    forth = float(np.linalg.norm(before[most]))
    back = -float(before[most] @ after[most]) / max(forth, 1e-9)
    cut = int(positions[most])
    is_sudden = times[cut + TURN] - times[cut - TURN] < SUDDEN
    return _Turn(cut, bool(is_sudden) and min(forth, back) > REVERSED)


def _find_jump(chain: Chain) -> int:
    """Number of the cluster before which a chain jumps farthest aside; 0 where it never does."""
    places, times = middles(chain), np.array([one.time for one in chain.clusters])
    gaps = np.maximum(np.diff(times), 1e-3)
    velocities = np.diff(places, axis=0) / gaps[:, None]
    aside = np.zeros(len(gaps))
    for link in range(len(gaps)):
        around = (velocities[max(0, link - NEAR_LINKS) : link], velocities[link + 1 : link + 1 + NEAR_LINKS])
        off = [np.linalg.norm(velocities[link] - np.median(some, axis=0)) for some in around if len(some)]
        aside[link] = gaps[link] * min(off, default=0.0)
    farthest = int(aside.argmax()) if len(aside) else 0
    return farthest + 1 if len(aside) and aside[farthest] > JUMP else 0


def moves_with_ego(places: Float64[ndarray, "t 2"], clouds: list[SweepCloud], sweeps: list[int]) -> bool:
    """Whether places, one in each of some sweeps, stay where they are in the recording car's own frame, near it.

    What creeps beside it in a jam stays at the same distance, too, but not in the same place, or in another lane.
    """
    offset = places - np.array([clouds[sweep].position[:2] for sweep in sweeps])
    if np.median(np.linalg.norm(offset, axis=1)) > EGO_REACH:
        return False
    heading = _ego_headings(clouds)[sweeps]
    cosine, sine = np.cos(heading), np.sin(heading)
    own = np.column_stack([cosine * offset[:, 0] + sine * offset[:, 1], cosine * offset[:, 1] - sine * offset[:, 0]])
    middle = np.median(own, axis=0)
    if abs(middle[1]) > EGO_HALF_WIDTH:
        return False
    drift = np.linalg.norm(own - middle, axis=1)
    return bool(np.percentile(drift, EGO_SHARE) < EGO_DRIFT)


def _ego_headings(clouds: list[SweepCloud]) -> Float64[ndarray, " s"]:
    """Direction of the recording car's way in each sweep, radians; where it stands, as before and after."""
    places = np.array([cloud.position[:2] for cloud in clouds])
    since, known, turns = 0, [], []
    for number in range(1, len(places)):
        step = places[number] - places[since]
        if np.linalg.norm(step) >= EGO_STEP:
            known.append((since + number) / 2)
            turns.append(np.arctan2(step[1], step[0]))
            since = number
    if not known:
        return np.zeros(len(places))
    return np.interp(np.arange(len(places)), known, np.unwrap(turns))


def motion_ratio(parts: list[ndarray], places: Float64[ndarray, "c 2"], yaws: ndarray | None = None) -> float:
    """Mean distance between clouds some way of travel apart with their motion taken off, as a share of the distance
    without; infinity where none are so far apart.

    Args:
        parts: points of the thing by observation, metres.
        places: where the thing is in each.
        yaws: how it is turned in each, radians; None = never.
    """
    samples = [sample_evenly(part, SAMPLE) for part in parts]
    yaws = np.zeros(len(parts)) if yaws is None else yaws
    chosen = _pair_nearest_in_time(places)
    if not chosen:
        return float("inf")
    with_motion, without = 0.0, 0.0
    for first, second in chosen:
        carried = carry(samples[first], places[first], yaws[first], places[second], yaws[second])
        with_motion += np.minimum(nearest_distances(carried, samples[second]), CLIP).mean()
        without += np.minimum(nearest_distances(samples[first], samples[second]), CLIP).mean()
    return float(with_motion / max(without, 1e-6))


def _pair_nearest_in_time(places: Float64[ndarray, "c 2"]) -> list[tuple[int, int]]:
    """Pairs of observations some way of travel apart, from all of the time: each with the next of those before and
    after it, as things change their looks on the way."""
    apart = np.linalg.norm(places[:, None] - places[None], axis=2) >= APART
    pairs = []
    for first, is_apart in enumerate(apart):
        before, after = np.flatnonzero(is_apart[:first])[-1:], first + 1 + np.flatnonzero(is_apart[first + 1 :])[:1]
        pairs += [(first, int(second)) for second in (*before, *after)]
    return pairs[:: max(1, -(-len(pairs) // COMPARED))]


def carry(points: ndarray, place: ndarray, yaw: float, new_place: ndarray, new_yaw: float) -> ndarray:
    """Points moved rigidly along the ground from one pose to another."""
    cosine, sine = np.cos(new_yaw - yaw), np.sin(new_yaw - yaw)
    moved = np.array(points, np.float32)
    offset = points[:, :2] - place
    moved[:, 0] = cosine * offset[:, 0] - sine * offset[:, 1] + new_place[0]
    moved[:, 1] = sine * offset[:, 0] + cosine * offset[:, 1] + new_place[1]
    return moved


def compute_solved_ratio(observations: list[Observation], trajectory: Trajectory) -> float:
    """`motion_ratio` of solved poses."""
    poses = trajectory.poses_at(np.array([one.time for one in observations]))
    return motion_ratio([one.points for one in observations], poses[:, :2], poses[:, 2])
