"""How well found tracks agree with annotated movers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64
from numpy import ndarray
from scipy.optimize import linear_sum_assignment

from instdrive_core.datasets.clip import Clip
from instdrive_core.datasets.twins import merge_twins
from instdrive_core.scene.track import Track, find_points_inside, interpolate_tracks

MIN_PATH = 1.0
"""Metres that a mover travels within the clip's sweeps."""
FARTHEST = 80.0
"""Metres from the cameras within which movers count."""
MATCH = 2.0
"""Metres between centres up to which a found box may be a mover's, and half of the mover's length if that is more."""
FOUND_SHARE = 0.5
"""Share of a mover's steps in which it must be matched to count as found."""
MANY, SOME = 100, 30
"""Points in one sweep that movers are told apart by."""
MARGIN, BOTTOM = 0.1, -0.1
"""Metres by which a box is grown to count its points; the road is cut off."""


@dataclass(frozen=True)
class Mover:
    """An annotated mover in the clip's sweeps."""

    track: Track
    times: Float64[ndarray, " s"]
    """Times of the sweeps that show it within reach, seconds."""
    counts: Int64[ndarray, " s"]
    """Points that met it in each."""

    @property
    def points(self) -> int:
        """Points in the sweep that shows most of it."""
        return int(self.counts.max())


@dataclass(frozen=True)
class TrackScores:
    """What `score_tracks` finds."""

    found: int
    movers: int
    """With at least `MANY` points in a sweep."""
    found_30: int
    movers_30: int
    """With at least `SOME`."""
    errors: Float64[ndarray, " e"]
    """Metres between centres along the ground, of every matched step of the movers found."""
    followed: float
    """Share of the points on all movers, in all sweeps, that lie where a found box is matched."""
    switches: int
    false: int
    """Found tracks that are nothing annotated as moving."""
    missed: tuple[str, ...]
    """IDs of movers with at least `SOME` points that were not found."""
    false_ids: tuple[str, ...]


def find_annotated_movers(clip: Clip) -> list[Mover]:
    """Movers of a clip's annotations, each object once, with the sweeps that show them."""
    tracks = merge_twins(clip.true_tracks).tracks
    places = {frame.view.time: frame.view.camera.position for frame in clip.frames}
    movers: dict[str, list[tuple[float, int]]] = {track.id: [] for track in tracks}
    for sweep in clip.sweeps:
        points = sweep.load().points
        ego = places[min(places, key=lambda time: abs(time - sweep.time))]
        for track in tracks:
            if not track.covers(sweep.time, 1e-3):
                continue
            pose = track.interpolate_pose(sweep.time)
            if np.linalg.norm(pose[:3, 3] - ego) > FARTHEST:
                continue
            near = points[np.abs(points[:, :2] - pose[:2, 3]).max(axis=1) < track.dimensions.max() + 1]
            count = int(find_points_inside(near, pose, track.dimensions, MARGIN, BOTTOM).sum())
            if count:
                movers[track.id].append((sweep.time, count))
    found = []
    for track in tracks:
        times = np.array([time for time, _ in movers[track.id]])
        if len(times) >= 2 and _path(track, times) > MIN_PATH:
            found.append(Mover(track, times, np.array([count for _, count in movers[track.id]])))
    return found


def score_tracks(found: tuple[Track, ...], movers: list[Mover], every: tuple[Track, ...] = ()) -> TrackScores:
    """Match found tracks to annotated movers step by step.

    Args:
        found: found tracks.
        movers: of the annotations, see `find_annotated_movers`.
        every: all annotated tracks: what lies on one that moves at all, or beyond reach, is not false.
    """
    matches: dict[str, list[tuple[str, float]]] = {mover.track.id: [] for mover in movers}
    followed = 0
    hits: dict[str, int] = {track.id: 0 for track in found}
    for time in sorted({float(time) for mover in movers for time in mover.times}):
        here = [mover for mover in movers if np.any(np.abs(mover.times - time) < 1e-6)]
        there = [track for track in found if track.covers(time, 0.051)]
        if not here or not there:
            continue
        centers = interpolate_tracks([mover.track for mover in here], time)[:, :2, 3]
        others = interpolate_tracks(there, time)[:, :2, 3]
        distance = np.linalg.norm(centers[:, None] - others[None], axis=2)
        reach = np.array([max(MATCH, mover.track.dimensions[1] / 2) for mover in here])[:, None]
        cost = np.where(distance < reach, distance, 1e3)
        for row, column in zip(*linear_sum_assignment(cost), strict=True):
            if distance[row, column] < reach[row, 0]:
                matches[here[row].track.id].append((there[column].id, float(distance[row, column])))
                followed += int(here[row].counts[np.abs(here[row].times - time) < 1e-6][0])
                hits[there[column].id] += 1
    is_found = {mover.track.id: len(matches[mover.track.id]) >= FOUND_SHARE * len(mover.times) for mover in movers}
    many = [mover for mover in movers if mover.points >= MANY]
    some = [mover for mover in movers if mover.points >= SOME]
    errors = [error for mover in many if is_found[mover.track.id] for _, error in matches[mover.track.id]]
    switches = sum(
        first[0] != second[0]
        for mover in some
        for first, second in zip(matches[mover.track.id], matches[mover.track.id][1:], strict=False)
    )
    false = [track.id for track in found if not hits[track.id] and not _on_any(track, every)]
    return TrackScores(
        sum(is_found[mover.track.id] for mover in many),
        len(many),
        sum(is_found[mover.track.id] for mover in some),
        len(some),
        np.array(errors),
        followed / max(1, sum(int(mover.counts.sum()) for mover in movers)),
        switches,
        len(false),
        tuple(mover.track.id for mover in some if not is_found[mover.track.id]),
        tuple(false),
    )


def _on_any(track: Track, every: tuple[Track, ...]) -> bool:
    """Whether a track lies, most of the time, on an annotated one that travels a little at least."""
    for other in every:
        if other.compute_path_length() < 0.5 * MIN_PATH:
            continue
        shared = np.array([time for time in track.times if other.covers(float(time), 0.051)])
        if not len(shared):
            continue
        apart = track.interpolate_poses(shared)[:, :2, 3] - other.interpolate_poses(shared)[:, :2, 3]
        if np.mean(np.linalg.norm(apart, axis=1) < max(MATCH, other.dimensions[1] / 2)) > 0.5:
            return True
    return False


def _path(track: Track, times: Float64[ndarray, " t"]) -> float:
    places = track.interpolate_poses(times)[:, :2, 3]
    return float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())
