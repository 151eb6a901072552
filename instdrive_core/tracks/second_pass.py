"""The second pass: once its motion is known, all of a thing's points are found, those too that seemed to stand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float32
from numpy import ndarray
from scipy import ndimage

from instdrive_core.tracks.boxes import classify_box
from instdrive_core.tracks.candidates import make_cluster
from instdrive_core.tracks.extension import extend_in_time
from instdrive_core.tracks.motion_tests import carry, motion_ratio
from instdrive_core.tracks.range_images import Votes
from instdrive_core.tracks.solved_thing import SolvedThing, solve_thing
from instdrive_core.tracks.strict_test import is_mover
from instdrive_core.tracks.sweep_clouds import SweepCloud
from instdrive_core.tracks.trajectory import SPACING, Trajectory

CELL = 0.3
"""Metres along an edge of the cells of a thing's frame."""
OFTEN = 0.5
"""Share of the sweeps in which points lie in a cell of the thing."""
REACH_ALONG, REACH_ACROSS, REACH_UP = 1.5, 0.7, 0.5
"""Metres around and above what is known of a thing within which it may go on."""
STANDING_RATIO = 0.8
"""`motion_ratio` from which on a part that was added stands still."""
LARGEST = {"Pedestrian": (1.2, 1.1), "Bicycle": (2.3, 1.1), "Car": (5.6, 2.4)}
"""Length and width in metres to which a thing may grow, by what it looks like so far."""
LORRY = (18.0, 3.2)
"""Limit for all others."""
SMALL = 3.0
"""Metres: things shorter than this are seen whole, and can go on by half of what is left at either end."""
MAX_CHANGE, CHANGE_OF_SIZE = 0.25, 0.25
"""Metres, and share of a thing's size, by which its places may change (median) when it is solved again; more, and it
slid onto something else."""
REACHES = (0.4, 0.35, 0.3, 0.25, 0.25, 0.25)
"""Metres within which points of two observations are of one place, step by step; poses are nearly right."""


def solve_again(thing: SolvedThing, clouds: list[SweepCloud], votes: list[Votes]) -> SolvedThing:
    """A thing with the sweeps it can be followed to and with all its points, solved again; as it was where it would be
    worse, or no mover any more."""
    trajectory, extra = extend_in_time(thing, clouds)
    rows = {one.sweep: one.rows for one in thing.clusters} | extra
    rows = _grow_thing(rows, trajectory, thing, clouds)
    clusters = [make_cluster(clouds[k], votes[k].is_seen_through, rows[k], k) for k in sorted(rows)]
    again = solve_thing(clusters, clouds, [trajectory], REACHES)
    if again is None or again.ratio > thing.ratio + 0.12 or _has_slid(thing, again):
        return thing
    again = replace(again, core_seen=thing.seen_through)
    return again if is_mover(again, clouds) else thing


def _has_slid(thing: SolvedThing, again: SolvedThing) -> bool:
    """Whether the middle of a thing's points is elsewhere since it was solved again, beyond what it grew by."""
    times = thing.trajectory.start + SPACING * np.arange(len(thing.trajectory.knots))
    places = []
    for one in (thing, again):
        local = one.local_points()
        middle = (np.percentile(local, 1, axis=0) + np.percentile(local, 99, axis=0))[:2] / 2
        poses = one.trajectory.poses_at(times)
        cosine, sine = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        turned = np.column_stack([cosine * middle[0] - sine * middle[1], sine * middle[0] + cosine * middle[1]])
        places.append(poses[:, :2] + turned)
    before, after = (np.ptp(one.local_points(), axis=0)[:2] for one in (thing, again))
    moved = float(np.median(np.linalg.norm(places[1] - places[0], axis=1)))
    return moved - float(np.abs(after - before).max()) / 2 > MAX_CHANGE + CHANGE_OF_SIZE * float(before.max())


def _grow_thing(
    rows: dict[int, ndarray], trajectory: Trajectory, thing: SolvedThing, clouds: list[SweepCloud]
) -> dict[int, ndarray]:
    """The rows of each sweep with those that lie, sweep after sweep, in the same cells of the thing's frame."""
    local = thing.local_points()
    low, high = np.percentile(local, 1, axis=0), np.percentile(local, 99, axis=0)
    length, width = LARGEST.get(classify_box(high[:2] - low[:2], float(high[2]))[0], LORRY)
    spare = np.maximum(np.array([length, width]) - (high - low)[:2], 0)
    if max(length, width) < SMALL:
        spare /= 2
    margin = np.minimum([REACH_ALONG, REACH_ACROSS], spare)
    corner = low[:2] - margin
    shape = tuple((np.ceil((high[:2] + margin - corner) / CELL).astype(int) + 1).tolist())
    seen, core = np.zeros(shape, int), np.zeros(shape, int)
    near: dict[int, tuple[ndarray, ndarray, ndarray]] = {}
    for sweep, own in rows.items():
        cloud = clouds[sweep]
        pose = trajectory.poses_at(np.array([float(cloud.times[own].mean())]))[0]
        reach = float(np.abs(np.concatenate([corner, high[:2] + margin])).max()) * 1.5
        close = np.flatnonzero(np.abs(cloud.points[:, :2] - pose[:2]).max(axis=1) < reach)
        close = np.union1d(close, own)
        places = _local(cloud.points[close], pose)
        cells = np.floor((places[:, :2] - corner) / CELL).astype(int)
        inside = np.all((cells >= 0) & (cells < shape), axis=1) & (cloud.points[close, 2] < high[2] + REACH_UP)
        close, cells = close[inside], cells[inside]
        is_own = np.isin(close, own)
        mark = np.zeros(shape, bool)
        mark[cells[:, 0], cells[:, 1]] = True
        seen += mark
        mark[:] = False
        mark[cells[is_own, 0], cells[is_own, 1]] = True
        core += mark
        near[sweep] = close, cells, is_own
    often = (seen >= max(2, OFTEN * len(rows))) | (core >= max(1, 0.15 * len(rows)))
    known = core >= max(1, 0.15 * len(rows))
    labels = np.zeros(often.shape, np.int32)
    ndimage.label(often, np.ones((3, 3)), output=labels)
    kept = often & np.isin(labels, np.unique(labels[known & (labels > 0)]))
    kept = _drop_standing(kept, known, near, trajectory, clouds, rows)
    grown = {}
    for sweep, (close, cells, is_own) in near.items():
        grown[sweep] = np.union1d(rows[sweep], close[kept[cells[:, 0], cells[:, 1]] | is_own])
    return grown


def _drop_standing(
    kept: ndarray,
    known: ndarray,
    near: dict[int, tuple[ndarray, ndarray, ndarray]],
    trajectory: Trajectory,
    clouds: list[SweepCloud],
    rows: dict[int, ndarray],
) -> ndarray:
    """The cells without added parts whose points fit better where nothing moves: what waits beside a thing."""
    parts = np.zeros(kept.shape, np.int32)
    ndimage.label(kept & ~np.asarray(ndimage.binary_dilation(known, np.ones((3, 3))), bool), output=parts)
    result = kept.copy()
    for part in range(1, int(parts.max()) + 1):
        clouds_of_part, places, yaws = [], [], []
        for sweep, (close, cells, _) in near.items():
            chosen = close[parts[cells[:, 0], cells[:, 1]] == part]
            if len(chosen) < 3:
                continue
            pose = trajectory.poses_at(np.array([float(clouds[sweep].times[rows[sweep]].mean())]))[0]
            clouds_of_part.append(clouds[sweep].points[chosen])
            places.append(pose[:2])
            yaws.append(pose[2])
        if len(places) < 2 or not motion_ratio(clouds_of_part, np.array(places), np.array(yaws)) < STANDING_RATIO:
            result[parts == part] = False
    return result


def _local(points: Float32[ndarray, "n 3"], pose: ndarray) -> Float32[ndarray, "n 3"]:
    return carry(points - np.array([pose[0], pose[1], 0], np.float32), np.zeros(2), pose[2], np.zeros(2), 0.0)
