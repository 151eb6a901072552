"""Where the surface is that a splat stands for: learned from a clip's own sweeps.

Splats are trained to look right, so many are centimetres thick or off the surface. Each ray of a sweep says how far the
surface is; for every splat that it meets nearby, the difference to where that splat is densest counts, weighted by the
light that the splat takes away. The mean is the splat's offset along rays, shrunk towards 0 where few rays say it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float32, Float64
from numpy import ndarray

from instdrive_core.datasets.clip import Sweep
from instdrive_core.progress import report
from instdrive_core.sweeps.cast import LidarRays, RayCaster
from instdrive_core.sweeps.pattern import trace_pattern
from instdrive_core.sweeps.rig import Rig

MOST_SWEEPS = 8
"""Sweeps that are looked at, evenly over the drive: more change nothing."""
_NEARBY = 0.5
"""Metres between a splat and the measured point, beyond which the ray met something else."""
_SHRINKING = 0.5
"""Light that has to be taken away for an offset to be half of what the rays say."""
_LEAST_LIGHT = 0.02
_MOST_RAYS = 20_000
"""Rays looked at in one go: each keeps a list of splats."""


def learn_offsets(
    caster: RayCaster, rig: Rig, sweeps: Sequence[Sweep], place: Float64[ndarray, "3"]
) -> Float32[ndarray, " n"]:
    """Learn by splat of the scene how far behind its densest place along a ray the surface is, metres.

    Splats that no ray meets have 0.

    Args:
        caster: of the scene that was trained from the clip, without offsets.
        rig: the clip's, in the scene's world.
        sweeps: that may train, in that world.
        place: of the sensor in the rig, metres.
    """
    sums, light = np.zeros(len(caster.scene)), np.zeros(len(caster.scene))
    chosen = choose_evenly(sweeps, MOST_SWEEPS)
    for done, sweep in enumerate(chosen):
        pattern = trace_pattern(rig, sweep.time, sweep.load(), place)
        rays, measured = pattern.aim(rig, sweep.time), pattern.ranges
        for start in range(0, len(rays), _MOST_RAYS):
            part = slice(start, start + _MOST_RAYS)
            met = caster.list_met(LidarRays(rays.origins[part], rays.directions[part], rays.times[part]))
            behind = (np.zeros(len(rays)) if measured is None else measured)[part, None] - met.depths
            counted = (met.weights > _LEAST_LIGHT) & (np.abs(behind) < _NEARBY)
            rows, weights = met.rows[counted], met.weights[counted]
            sums += np.bincount(rows, weights * behind[counted], len(sums))
            light += np.bincount(rows, weights, len(light))
        report((done + 1) / len(chosen))
    return (sums / (light + _SHRINKING)).astype(np.float32)


def choose_evenly(sweeps: Sequence[Sweep], most: int) -> list[Sweep]:
    """Choose at most so many sweeps, evenly over the drive."""
    if not sweeps:
        return []
    rows = np.unique(np.linspace(0, len(sweeps) - 1, most).round().astype(int))
    return [sweeps[row] for row in rows.tolist()]
