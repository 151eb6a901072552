"""Where a clip's LiDAR sits: no data set's points say it once they are in the world, but a trained scene can tell."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.datasets.clip import Sweep, SweepPoints
from instdrive_core.sweeps.cast import LidarRays, RayCaster
from instdrive_core.sweeps.pattern import AMID, trace_pattern
from instdrive_core.sweeps.rig import Rig

HEIGHTS = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)
"""Metres above the cameras that are tried: LiDARs sit on the roof, cameras on or below it."""
_MOST_RAYS = 8000
_FAR_OFF = 1.0


def find_sensor_place(caster: RayCaster, rig: Rig, sweep: Sweep) -> Float64[ndarray, "3"]:
    """Find the height above the cameras from which casting a sweep's rays meets what the sweep met.

    Args:
        caster: of the scene that was trained from the clip.
        rig: the clip's, in the scene's world.
        sweep: one of the clip's, in that world.

    Returns the sensor's place in the rig, metres.
    """
    found = sweep.load()
    tried = [AMID + np.array([0.0, 0.0, height]) for height in HEIGHTS]
    return min(tried, key=lambda place: _measure_miss(caster, rig, sweep.time, found, place))


def _measure_miss(
    caster: RayCaster, rig: Rig, moment: float, found: SweepPoints, place: Float64[ndarray, "3"]
) -> float:
    """Mean metres between measured and cast ranges; what is off by more than `_FAR_OFF`, or missing, counts that."""
    pattern = trace_pattern(rig, moment, found, place)
    rays = pattern.aim(rig, moment)
    some = slice(None, None, max(1, len(rays) // _MOST_RAYS))
    part = LidarRays(rays.origins[some], rays.directions[some], rays.times[some])
    ranges = caster.cast(part).ranges
    measured = np.zeros(len(part)) if pattern.ranges is None else pattern.ranges[some]
    return float(np.minimum(np.abs(ranges - measured), _FAR_OFF).mean()) if len(part) else np.inf
