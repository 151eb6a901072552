"""Things that creep: whole vehicles most of whose points look as if they stood.

A car that goes one to three metres in as many seconds overlaps itself all the way, so that most places where it was met
are met again. What is clustered of the other points are slivers. Here whole clusters of a vehicle's size are followed,
whether or not their points seem to stand; the places that they left prove that they moved (`vacated.py`).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float32, Int64
from numpy import ndarray
from scipy import ndimage

from instdrive_core.tracks.candidates import Cluster, cluster_cloud, make_cluster
from instdrive_core.tracks.fragments import LORRY, TALL
from instdrive_core.tracks.linking import link_sightings
from instdrive_core.tracks.motion_tests import MIN_SWEEPS
from instdrive_core.tracks.range_images import Votes, group_points
from instdrive_core.tracks.solved_thing import SolvedThing, solve_thing
from instdrive_core.tracks.starts import first_guesses
from instdrive_core.tracks.strict_test import PROVED_WAY, is_mover
from instdrive_core.tracks.sweep_clouds import SweepCloud
from instdrive_core.tracks.vacated import may_vacate, vacates

CAR = (6.5, 3.0)
"""Length and width in metres to which a cluster is a whole car; what is taller than `TALL` may be a lorry."""
MIN_LENGTH, LOWEST_TOP, HIGHEST_TOP = 0.8, 0.8, 4.4
"""Metres along the ground, and heights of the highest point: what is shorter or lower is no vehicle, what is higher no
single one."""
MIN_POINTS = 12
NEAR_CELL, OFTEN = 2.0, 5
"""Metres along an edge of the cells of a map of what may move, and points of all sweeps that must: where nothing ever
does, nothing creeps."""
CREEP, MISSED = 1.5, 2
"""Metres per second below which a thing creeps, and sweeps at either end of the clip for which it may be missed."""


def find_creepers(things: list[SolvedThing], clouds: list[SweepCloud], votes: list[Votes]) -> list[SolvedThing]:
    """Vehicles that move, of the points that are no mover's yet, or of one that was lost sight of while it crept.

    Args:
        things: the movers that are known.
        clouds, votes: one for each sweep, in order of time.
    """
    if not any(len(cloud.points) for cloud in clouds):
        return []
    free = [np.ones(len(cloud.points), bool) for cloud in clouds]
    for thing in things:
        if _is_lost_creeping(thing, len(clouds)):
            continue
        for one in thing.clusters:
            free[one.sweep][one.rows] = False
    near = _find_near_moving(clouds, votes)
    by_sweep = [
        _find_vehicles(cloud, seen, number, np.flatnonzero(free[number] & near[number]))
        for number, (cloud, seen) in enumerate(zip(clouds, votes, strict=True))
    ]
    creepers = []
    for chain in link_sightings(by_sweep):
        if len(chain.clusters) < MIN_SWEEPS:
            continue
        guesses = first_guesses(chain)
        goes = [guess for guess in guesses if guess.farthest_way() >= PROVED_WAY]
        if not any(may_vacate(chain.clusters, guess, clouds) for guess in goes):
            continue
        solved = solve_thing(chain.clusters, clouds, guesses)
        if solved is not None and vacates(solved, clouds) and is_mover(solved, clouds):
            creepers.append(solved)
    return creepers


def _is_lost_creeping(thing: SolvedThing, sweeps: int) -> bool:
    """Whether a thing begins or ends amid the clip while it hardly moves: it stood before, or stands then."""
    first, last = thing.trajectory.velocities_at(np.array([thing.trajectory.start, thing.trajectory.end - 1e-6]))
    is_late = thing.sweeps[0] > MISSED and np.linalg.norm(first) < CREEP
    is_early = thing.sweeps[-1] < sweeps - 1 - MISSED and np.linalg.norm(last) < CREEP
    return bool(is_late or is_early)


def _find_near_moving(clouds: list[SweepCloud], votes: list[Votes]) -> list[Bool[ndarray, " n"]]:
    """Points of each cloud in cells, or beside cells, where something may move in some sweep."""
    cells = [np.floor(cloud.points[:, :2] / NEAR_CELL).astype(np.int64) for cloud in clouds]
    low = np.min([own.min(axis=0) for own in cells if len(own)], axis=0)
    high = np.max([own.max(axis=0) for own in cells if len(own)], axis=0)
    counts = np.zeros((high - low + 1).tolist(), np.int64)
    for own, seen in zip(cells, votes, strict=True):
        moving = own[~seen.is_static] - low
        np.add.at(counts, (moving[:, 0], moving[:, 1]), 1)
    near = ndimage.binary_dilation(counts >= OFTEN, np.ones((3, 3)), iterations=2)
    return [near[own[:, 0] - low[0], own[:, 1] - low[1]] for own in cells]


def _find_vehicles(cloud: SweepCloud, votes: Votes, sweep: int, rows: Int64[ndarray, " r"]) -> list[Cluster]:
    """Clusters of a sweep's points that may be whole vehicles, or the sides of one that are seen."""
    if not len(rows):
        return []
    chosen, cell = group_points(cloud.points[rows])
    place = np.full(len(cloud.points), -1)
    place[rows[chosen]] = np.arange(len(chosen))
    numbers = np.empty(len(chosen), np.int64)
    parts = cluster_cloud(cloud, rows[chosen])
    for number, part in enumerate(parts):
        numbers[place[part]] = number
    owner = numbers[cell]
    order = np.argsort(owner, kind="stable")
    whole = np.split(rows[order], np.flatnonzero(np.diff(owner[order])) + 1)
    return [
        make_cluster(cloud, votes.is_seen_through, np.sort(part), sweep)
        for part in whole
        if len(part) >= MIN_POINTS and _is_like_vehicle(cloud.points[part])
    ]


def _is_like_vehicle(points: Float32[ndarray, "k 3"]) -> bool:
    top = float(points[:, 2].max())
    if not LOWEST_TOP <= top <= HIGHEST_TOP:
        return False
    length, width = LORRY if top > TALL else CAR
    places = points[:, :2] - points[:, :2].mean(axis=0)
    if np.linalg.norm(np.ptp(places, axis=0)) > length + width:
        return False
    _, axes = np.linalg.eigh(places.T @ places)
    across, along = np.ptp(places @ axes, axis=0)
    return bool(MIN_LENGTH <= along <= length and across <= width)
