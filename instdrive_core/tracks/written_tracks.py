"""Solved things as tracks: a box and its pose at each time step, as data sets give them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.datasets.clip import Clip
from instdrive_core.datasets.twins import merge_twins
from instdrive_core.scene.track import Track
from instdrive_core.tracks.boxes import TrackBox
from instdrive_core.tracks.solved_thing import SolvedThing
from instdrive_core.tracks.sweep_clouds import SweepCloud
from instdrive_core.tracks.trajectory import SPACING, Trajectory

SLACK = 0.06
"""Seconds by which a time step may lie outside of what was observed: half a step at 10 Hz."""
WHEELED = 1.4
"""Metres: what is longer rolls along its heading."""
WINDOW, SLID = 5, 0.5
"""Knots over which a thing must not come farther across its heading than along it, by so many metres at least: from
there on it was mistaken for what stands or drives beside it."""


def convert_to_tracks(things: list[SolvedThing], clouds: list[SweepCloud], clip: Clip) -> tuple[Track, ...]:
    """The tracks of things, each object once, named by the order in which they appear.

    A pose holds for the moment at which the first LiDAR, and with it the cameras, looked at the thing in that step: as
    cuboids do.
    """
    ordered = sorted(things, key=lambda thing: (thing.trajectory.start, -thing.point_count))
    tracks = [_track(f"found-{number:03d}", thing, clouds, clip) for number, thing in enumerate(ordered, 1)]
    return merge_twins(tuple(track for track in tracks if track is not None)).tracks


def _track(name: str, thing: SolvedThing, clouds: list[SweepCloud], clip: Clip) -> Track | None:
    box = thing.box(clouds)
    start, end = find_rolling_span(thing.trajectory, box)
    times, poses = [], []
    for time in sorted({frame.view.time for frame in clip.frames} | {cloud.time for cloud in clouds}):
        seen = find_moment(thing, clouds, time)
        if not start - SLACK <= seen <= end + SLACK:
            continue
        times.append(time)
        poses.append(box_pose(thing, box, seen, clouds))
    if not times:
        return None
    return Track(
        name,
        box.label,
        np.array([box.width, box.length, box.height]),
        np.array(times),
        np.stack(poses),
        moving=True,
    )


def find_rolling_span(trajectory: Trajectory, box: TrackBox) -> tuple[float, float]:
    """Find the longest span, in seconds, in which a thing's box rolls along its heading.

    All of the trajectory where that is short, or where the thing slides half of the time: then its heading is wrong.
    """
    knots = trajectory.knots
    if box.length <= WHEELED or len(knots) <= WINDOW:
        return trajectory.start, trajectory.end
    middles = _place_middles(knots, box)
    way, heading = middles[WINDOW:] - middles[:-WINDOW], (knots[WINDOW:, 2] + knots[:-WINDOW, 2]) / 2
    along = np.abs(np.cos(heading) * way[:, 0] + np.sin(heading) * way[:, 1])
    across = np.abs(np.cos(heading) * way[:, 1] - np.sin(heading) * way[:, 0])
    slides = across > np.maximum(SLID, along)
    if slides.mean() > 0.5:
        return trajectory.start, trajectory.end
    rolls = np.ones(len(knots), bool)
    for first in np.flatnonzero(slides):
        rolls[first + WINDOW // 2 : first + WINDOW // 2 + 2] = False  # one more knot than windows: some are left
    rolls[: WINDOW // 2], rolls[-(WINDOW // 2) :] = rolls[WINDOW // 2], rolls[-(WINDOW // 2) - 1]
    edges = np.flatnonzero(np.diff(np.r_[False, rolls, False])).reshape(-1, 2)
    begin, stop = max(edges.tolist(), key=lambda span: span[1] - span[0])
    return trajectory.start + SPACING * begin, trajectory.start + SPACING * (stop - 1)


def find_moment(thing: SolvedThing, clouds: list[SweepCloud], time: float) -> float:
    """When the first LiDAR looked at a thing in the turn of a time step, seconds."""
    nearest = min(clouds, key=lambda cloud: abs(cloud.time - time))
    place = thing.trajectory.poses_at(np.array([time]))[0, :2]
    seen = [one.time for one in thing.observations if clouds[one.sweep] is nearest and one.sensor == 0]
    if seen and abs(nearest.time - time) < 1e-3:
        return seen[0]
    return time + nearest.time_towards(place) - nearest.time


def box_pose(thing: SolvedThing, box: TrackBox, time: float, clouds: list[SweepCloud]) -> Float64[ndarray, "4 4"]:
    """world_from_box of a thing at a moment; the box's y axis is its heading."""
    at = thing.trajectory.poses_at(np.array([time]))
    cosine, sine = np.cos(at[0, 2]), np.sin(at[0, 2])
    pose = np.eye(4)
    pose[:2, 0], pose[:2, 1] = (sine, -cosine), (cosine, sine)
    pose[:2, 3] = _place_middles(at, box)[0]
    pose[2, 3] = ground_under(thing, time, clouds) + box.height / 2
    return pose


def _place_middles(poses: Float64[ndarray, "t 3"], box: TrackBox) -> Float64[ndarray, "t 2"]:
    """Where the middle of a thing's box is at some of its poses, metres."""
    (x, y, yaw), (ahead, left) = poses.T, box.center
    cosine, sine = np.cos(yaw), np.sin(yaw)
    return np.column_stack([x + cosine * ahead - sine * left, y + sine * ahead + cosine * left])


def ground_under(thing: SolvedThing, time: float, clouds: list[SweepCloud]) -> float:
    """z of the ground where a thing stands at a moment, from its points around that time."""
    times = np.array([clouds[one.sweep].time for one in thing.clusters])
    heights = np.array([float(np.median(clouds[one.sweep].heights[one.rows])) for one in thing.clusters])
    return float(np.interp(time, times, heights))
