"""Things followed on in time by what is known of their shape: cars that stop, start, or hide stay one object."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, Float64
from numpy import ndarray

from instdrive_core.tracks.motion_tests import carry
from instdrive_core.tracks.nearest import align, nearest_distances, sample_evenly
from instdrive_core.tracks.solved_thing import SolvedThing
from instdrive_core.tracks.sweep_clouds import SweepCloud
from instdrive_core.tracks.trajectory import SPACING, Trajectory, even_knots

MAX_RESIDUAL = 0.12
"""Metres: median distance of the thing's points from a sweep's where it is found again."""
MIN_SHARE, MATCHED = 0.35, 0.2
"""Share of the thing's points that must have one within so many metres."""
MIN_MODEL = 25
"""Points of a shape that can be found again."""
MODEL, AROUND = 250, 400
"""Points of the shape, and of the sweep around it, that are compared."""
RECENT = 6
"""Observations nearest in time that the shape is taken from: it is seen from the same side still."""
MAX_STEP = 0.8
"""Metres by which a thing may lie off where it is looked for."""
MAX_MISSES = 2
"""Sweeps in a row in which it may be missed."""
DECAYS = (1.0, 0.6, 0.0)
"""Shares of its last velocity with which it is looked for: it goes on, brakes, or stands."""
EDGE = 0.15
"""Metres around the shape's box within which a sweep's points are the thing's."""


def extend_in_time(thing: SolvedThing, clouds: list[SweepCloud]) -> tuple[Trajectory, dict[int, ndarray]]:
    """The trajectory of a thing with the sweeps before, in between and after where it was found again, and the rows of
    its points there, by sweep."""
    local = thing.local_points()
    if len(local) < MIN_MODEL:
        return thing.trajectory, {}
    known = {one.sweep: thing.trajectory.poses_at(np.array([one.time]))[0] for one in thing.clusters}
    times = {one.sweep: one.time for one in thing.clusters}
    rows: dict[int, ndarray] = {}
    low, high = np.percentile(local, 1, axis=0), np.percentile(local, 99, axis=0)
    for direction in (1, -1):
        sweep = max(known) if direction == 1 else min(known)
        misses = 0
        while 0 <= sweep + direction < len(clouds) and misses < MAX_MISSES:
            sweep += direction
            found = _find_again(thing, clouds[sweep], known, times, direction, low, high)
            if found is None:
                misses += 1
                continue
            misses = 0
            known[sweep], times[sweep], rows[sweep] = found
    if not rows:
        return thing.trajectory, {}
    return _through(known, times, thing.trajectory), rows


def _find_again(
    thing: SolvedThing,
    cloud: SweepCloud,
    known: dict[int, ndarray],
    times: dict[int, float],
    direction: int,
    low: Float64[ndarray, "3"],
    high: Float64[ndarray, "3"],
) -> tuple[Float64[ndarray, "3"], float, ndarray] | None:
    """Pose, time and rows of a thing in one more sweep; None where its shape is not there."""
    order = sorted(known, reverse=direction == 1)
    last = known[order[0]]
    far = next((one for one in order if abs(times[one] - times[order[0]]) > 0.25), order[-1])
    span = times[order[0]] - times[far]
    velocity = (last[:2] - known[far][:2]) / span if span else np.zeros(2)
    time = cloud.time_towards(last[:2])
    gap = time - times[order[0]]
    reach = float(np.linalg.norm(high[:2] - low[:2])) / 2 + 1.5 + float(np.linalg.norm(velocity)) * abs(gap)
    centre = last[:2] + _turn_points((low[:2] + high[:2]) / 2, last[2])
    near = np.flatnonzero(np.abs(cloud.points[:, :2] - centre).max(axis=1) < reach + 1.0)
    if len(near) < MIN_MODEL // 2:
        return None
    model = _recent_points(thing, times[order[0]])
    if len(model) < MIN_MODEL:
        return None
    around = sample_evenly(cloud.points[near], AROUND)
    best: tuple[float, Float64[ndarray, "3"]] | None = None
    for decay in DECAYS:
        pose = last.copy()
        pose[:2] += decay * velocity * gap
        placed = carry(model, np.zeros(2), 0.0, pose[:2], pose[2])
        shift, _ = align(placed, around, np.zeros(2), 0.6)
        if np.linalg.norm(shift) > MAX_STEP:
            continue
        placed[:, :2] += shift.astype(np.float32)
        distances = nearest_distances(placed, around)
        share = float((distances < MATCHED).mean())
        residual = _measure_residual(placed, around, distances) if share else 1.0
        pose[:2] += shift
        if share >= MIN_SHARE and residual < MAX_RESIDUAL and (best is None or residual - share < best[0]):
            best = (residual - share, pose)
    if best is None:
        return None
    pose = best[1]
    rows = near[inside_box(cloud.points[near], pose, low - EDGE, high + EDGE)]
    if len(rows) < 5:
        return None
    return pose, float(cloud.times[rows].mean()), rows


def _measure_residual(
    placed: Float32[ndarray, "m 3"], around: Float32[ndarray, "n 3"], distances: Float32[ndarray, " m"]
) -> float:
    """Metres by which a shape's points lie off those of a sweep, or these off the shape, whichever is less: the one of
    which there are more lies between the other's rows."""
    back = nearest_distances(around, placed)
    return float(min(np.median(own[own < 2 * MATCHED]) for own in (distances, back)))


def _recent_points(thing: SolvedThing, time: float) -> Float32[ndarray, "m 3"]:
    """Points in the thing's frame of the observations nearest to a time."""
    order = np.argsort([abs(one.time - time) for one in thing.observations])[:RECENT]
    local = thing.local_points()
    starts = thing.packed.starts
    parts = [local[starts[number] : starts[number + 1]] for number in order]
    return sample_evenly(np.concatenate(parts).astype(np.float32), MODEL)


def inside_box(
    points: Float32[ndarray, "n 3"],
    pose: Float64[ndarray, "3"],
    low: Float64[ndarray, "3"],
    high: Float64[ndarray, "3"],
) -> ndarray:
    """Whether points lie in a box given in the frame of a pose."""
    local = carry(points - np.array([pose[0], pose[1], 0], np.float32), np.zeros(2), pose[2], np.zeros(2), 0.0)
    return np.all((local >= low) & (local <= high), axis=1)


def _turn_points(offset: Float64[ndarray, "2"], yaw: float) -> Float64[ndarray, "2"]:
    return np.array(
        [np.cos(yaw) * offset[0] - np.sin(yaw) * offset[1], np.sin(yaw) * offset[0] + np.cos(yaw) * offset[1]]
    )


def _through(known: dict[int, ndarray], times: dict[int, float], solved: Trajectory) -> Trajectory:
    """The trajectory through the known poses; solved ones as they were."""
    sweeps = sorted(known, key=lambda sweep: times[sweep])
    moments = np.array([times[sweep] for sweep in sweeps])
    poses = np.array([known[sweep] for sweep in sweeps])
    start, count = even_knots(np.concatenate([moments, [solved.start, solved.end]]))
    knot_times = start + SPACING * np.arange(count)
    knots = np.stack([np.interp(knot_times, moments, poses[:, axis]) for axis in range(3)], axis=1)
    within = (knot_times >= solved.start) & (knot_times <= solved.end)
    knots[within] = solved.poses_at(knot_times[within])
    return Trajectory(start, knots)
