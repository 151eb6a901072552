"""Where a LiDAR looks during one sweep, and when: directions in the rig's axes, seconds from the moment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Float64
from numpy import ndarray

from instdrive_core.datasets.clip import SweepPoints
from instdrive_core.sweeps.cast import LidarRays
from instdrive_core.sweeps.rig import Rig

AMID = np.zeros(3)
"""Amid the cameras."""
LATEST = 1.0
"""Seconds that a point's time may lie off its sweep's; beyond, the times are those of another clock."""


@dataclass(frozen=True)
class Pattern:
    """One sweep of a sensor that is fixed to the rig."""

    directions: Float32[ndarray, "r 3"]
    """Unit vectors: x forward, y left, z up."""
    delays: Float32[ndarray, " r"]
    """Seconds after the moment of the sweep; may be negative."""
    place: Float64[ndarray, "3"]
    """Where the sensor sits in the rig, metres."""
    near: float = 1.0
    far: float = 200.0
    """Metres between which the sensor measures."""
    noise: float = 0.0
    """Standard deviation of measured ranges, metres."""
    ranges: Float32[ndarray, " r"] | None = None
    """What the traced sweep measured, metres; None for described sensors."""

    def aim(self, rig: Rig, moment: float) -> LidarRays:
        """Aim at a moment (seconds): each ray starts where the rig is at its own time."""
        times = moment + self.delays.astype(np.float64)
        places, turns = rig.place(times)
        directions = np.einsum("nij,nj->ni", turns, self.directions.astype(np.float64))
        if self.place.any():
            places = places + turns @ self.place
        return LidarRays(places, directions, times)


def trace_pattern(rig: Rig, moment: float, found: SweepPoints, place: Float64[ndarray, "3"] = AMID) -> Pattern:
    """Trace the directions in which a clip's sweep met something.

    Directions in which nothing returned are not in it. Of several LiDARs the first one is taken.

    Args:
        rig: the clip's, in the world of the points.
        moment: of the sweep, seconds.
        found: the sweep.
        place: of the sensor in the rig, metres.
    """
    own = found.sensor == found.sensor.min() if len(found.sensor) else np.zeros(0, bool)
    points = found.points[own].astype(np.float64)
    times = np.full(len(points), moment) if found.times is None else found.times[own]
    if np.abs(times - moment).max(initial=0) > LATEST:
        times = np.full(len(points), moment)
    places, turns = rig.place(times)
    offsets = np.einsum("nji,nj->ni", turns, points - places) - place
    lengths = np.linalg.norm(offsets, axis=1)
    kept = lengths > 0.1
    directions = (offsets[kept] / lengths[kept, None]).astype(np.float32)
    near = float(np.floor(10 * np.quantile(lengths[kept], 0.001)) / 10) if kept.any() else 1.0
    return Pattern(
        directions,
        (times[kept] - moment).astype(np.float32),
        place,
        max(near, 0.5),
        ranges=lengths[kept].astype(np.float32),
    )
