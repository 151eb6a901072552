"""Where a thing is over time: places and headings at even moments, straight in between."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64
from numpy import ndarray

SPACING = 0.1
"""Seconds between knots, whatever the sensor's rate."""


@dataclass(frozen=True)
class Trajectory:
    """Poses along the ground: x, y (metres) and yaw (radians, continuous; 0 = heading along x)."""

    start: float
    """Time of the first knot, seconds."""
    knots: Float64[ndarray, "k 3"]

    @property
    def end(self) -> float:
        """Time of the last knot, seconds."""
        return self.start + SPACING * (len(self.knots) - 1)

    def between(self, times: Float64[ndarray, " t"]) -> tuple[Int64[ndarray, " t"], Float64[ndarray, " t"]]:
        """The knot before each time, and how far the time is on the way to the next; beyond the ends, straight on."""
        at = (np.asarray(times, float) - self.start) / SPACING
        before = np.clip(np.floor(at), 0, max(0, len(self.knots) - 2)).astype(np.int64)
        return before, at - before

    def poses_at(self, times: Float64[ndarray, " t"]) -> Float64[ndarray, "t 3"]:
        """Poses at some times; beyond the ends, motion goes on as it was and the heading stays."""
        before, fraction = self.between(times)
        after = np.minimum(before + 1, len(self.knots) - 1)
        poses = (1 - fraction)[:, None] * self.knots[before] + fraction[:, None] * self.knots[after]
        inside = np.clip(fraction, 0, 1)
        poses[:, 2] = (1 - inside) * self.knots[before, 2] + inside * self.knots[after, 2]
        return poses

    def velocities_at(self, times: Float64[ndarray, " t"]) -> Float64[ndarray, "t 2"]:
        """Metres per second."""
        if len(self.knots) < 2:
            return np.zeros((len(times), 2))
        before, _ = self.between(times)
        return (self.knots[before + 1, :2] - self.knots[before, :2]) / SPACING

    def net_way(self) -> float:
        """Metres from the first to the last knot."""
        return float(np.linalg.norm(self.knots[-1, :2] - self.knots[0, :2]))

    def farthest_way(self) -> float:
        """Metres between the two knots farthest from each other."""
        places = self.knots[:, :2]
        return float(np.linalg.norm(places[:, None] - places[None], axis=2).max())

    def with_knots(self, knots: Float64[ndarray, "k 3"]) -> Trajectory:
        """Copy with other poses at the same moments."""
        return Trajectory(self.start, knots)


def even_knots(times: Float64[ndarray, " t"]) -> tuple[float, int]:
    """First moment and number of the knots that span some times."""
    first, last = float(np.min(times)), float(np.max(times))
    return first, max(2, int(np.ceil((last - first) / SPACING - 1e-6)) + 1)
