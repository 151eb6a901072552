"""A moving object's box and its pose over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64, UInt8
from numpy import ndarray

from instdrive_core.maths.rotations import matrix_from_quaternion, quaternion_from_matrix, slerp
from instdrive_core.scene.camera import PhotoLag


@dataclass(frozen=True)
class Track:
    """A cuboid over time. Box frame: origin at the box centre, x width (right), y length (forward), z height (up)."""

    id: str
    """Unique in the clip (PandaSet: the cuboid's uuid)."""
    label: str
    dimensions: Float64[ndarray, "3"]
    """Width, length, height in metres."""
    times: Float64[ndarray, " t"]
    """Seconds, rising."""
    world_from_box: Float64[ndarray, "t 4 4"]
    moving: bool = False

    def compute_path_length(self) -> float:
        """Compute the metres that the centre travels over the whole track."""
        return float(np.linalg.norm(np.diff(self.world_from_box[:, :3, 3], axis=0), axis=1).sum())

    def covers(self, time: float, slack: float = 0.06) -> bool:
        """Whether `time` lies within the track, up to `slack` seconds (half a 10 Hz step)."""
        return bool(self.times[0] - slack <= time <= self.times[-1] + slack)

    def interpolate_position(self, time: float) -> Float64[ndarray, "3"]:
        """Interpolate where the box's centre is at `time`: what `interpolate_pose` has in its last column."""
        places = self.world_from_box[:, :3, 3]
        return np.array([np.interp(time, self.times, places[:, axis]) for axis in range(3)])

    def find_shown_time(self, time: float, lag: PhotoLag | None) -> float:
        """Find the moment of this track that a photo of the step at `time` shows."""
        return time if lag is None else time + lag.find(self.interpolate_position(time))

    def interpolate_pose(self, time: float, lag: PhotoLag | None = None) -> Float64[ndarray, "4 4"]:
        """Interpolate world_from_box at `time`: linear and slerp between neighbours, clamped at the ends.

        With a photo's `lag`, as the photo shows it; before the first pose and after the last it goes on as fast.
        """
        return interpolate_tracks((self,), time, lag)[0]

    def find_way_beyond(self, time: float) -> Float64[ndarray, "3"]:
        """Metres from the first or last pose to where the object is at `time` before or after it."""
        early, late = min(time - self.times[0], 0.0), max(time - self.times[-1], 0.0)
        if not early + late or len(self.times) < 2:
            return np.zeros(3)
        end = slice(0, 2) if early else slice(-2, None)
        return (early + late) / np.ptp(self.times[end]) * np.diff(self.world_from_box[end, :3, 3], axis=0)[0]

    def interpolate_poses(self, times: Float64[ndarray, " k"]) -> Float64[ndarray, "k 4 4"]:
        """Interpolate world_from_box at many `times` (seconds), for each as `interpolate_pose` does."""
        upper, last = np.searchsorted(self.times, times), len(self.times) - 1
        lower, upper = np.clip(upper - 1, 0, last), np.minimum(upper, last)
        steps = self.times[upper] - self.times[lower]
        shares = np.where(steps > 0, (times - self.times[lower]) / np.where(steps > 0, steps, 1), 0)
        return _blend_poses(self.world_from_box[lower], self.world_from_box[upper], shares)


def interpolate_tracks(tracks: Sequence[Track], time: float, lag: PhotoLag | None = None) -> Float64[ndarray, "m 4 4"]:
    """Interpolate world_from_box of many tracks at one time (seconds), for each as its `interpolate_pose` does."""
    ends, shares, beyond = np.empty((2, len(tracks), 4, 4)), np.zeros(len(tracks)), np.zeros((len(tracks), 3))
    for place, track in enumerate(tracks):
        shown = track.find_shown_time(time, lag)
        upper, last = int(np.searchsorted(track.times, shown)), len(track.times) - 1
        lower, upper = max(upper - 1, 0), min(upper, last)
        ends[:, place] = track.world_from_box[lower], track.world_from_box[upper]
        if track.times[upper] > track.times[lower]:
            shares[place] = (shown - track.times[lower]) / (track.times[upper] - track.times[lower])
        if lag is not None:
            beyond[place] = track.find_way_beyond(shown)
    poses = _blend_poses(ends[0], ends[1], shares)
    poses[:, :3, 3] += beyond
    return poses


def find_node_poses(
    actors: Sequence[Track], time: float, lag: PhotoLag | None = None
) -> tuple[Float64[ndarray, "m 4 4"], UInt8[ndarray, " m"]]:
    """Find world_from_node of background and actors at `time` (seconds), as a photo with this `lag` shows them, and
    which of them exist then."""
    present = [True, *(actor.covers(time) for actor in actors)]
    return np.concatenate([np.eye(4)[None], interpolate_tracks(actors, time, lag)]), np.array(present, np.uint8)


def _blend_poses(
    start: Float64[ndarray, "k 4 4"], end: Float64[ndarray, "k 4 4"], shares: Float64[ndarray, " k"]
) -> Float64[ndarray, "k 4 4"]:
    """Go a share of the way between poses; one beyond either end is that end, to the bit."""
    poses = np.where((shares > 0)[:, None, None], end, start)
    between = np.flatnonzero((shares > 0) & (shares < 1))
    if len(between):
        start, end, shares = start[between], end[between], shares[between]
        turns = slerp(quaternion_from_matrix(start[:, :3, :3]), quaternion_from_matrix(end[:, :3, :3]), shares)
        poses[between, :3, :3] = matrix_from_quaternion(turns)
        poses[between, :3, 3] = (1 - shares)[:, None] * start[:, :3, 3] + shares[:, None] * end[:, :3, 3]
    return poses


def find_points_inside(
    points: Float[ndarray, "n 3"],
    world_from_box: Float64[ndarray, "4 4"],
    dimensions: Float64[ndarray, "3"],
    margin: float = 0.0,
    bottom: float | None = None,
) -> ndarray:
    """Find the points inside a box grown by `margin` metres; `bottom` replaces the margin of the lower face
    (negative cuts the road off)."""
    local = (points - world_from_box[:3, 3]) @ world_from_box[:3, :3]
    half = np.asarray(dimensions) / 2
    lower = -half - margin
    if bottom is not None:
        lower[2] = -half[2] - bottom
    return np.all((local >= lower) & (local <= half + margin), axis=1)
