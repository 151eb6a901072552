"""A moving object's box and its pose over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

from instdrive_core.maths.rotations import matrix_from_quaternion, quaternion_from_matrix, slerp


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

    def interpolate_pose(self, time: float) -> Float64[ndarray, "4 4"]:
        """Interpolate world_from_box at `time`: linear and slerp between neighbours, clamped at the ends."""
        upper = int(np.searchsorted(self.times, time))
        if upper == 0 or upper == len(self.times):
            return self.world_from_box[min(upper, len(self.times) - 1)].copy()
        lower = upper - 1
        fraction = float((time - self.times[lower]) / (self.times[upper] - self.times[lower]))
        start, end = self.world_from_box[lower], self.world_from_box[upper]
        quats = quaternion_from_matrix(np.stack([start[:3, :3], end[:3, :3]]))
        pose = np.eye(4)
        pose[:3, :3] = matrix_from_quaternion(slerp(quats[0], quats[1], fraction))
        pose[:3, 3] = (1 - fraction) * start[:3, 3] + fraction * end[:3, 3]
        return pose


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
