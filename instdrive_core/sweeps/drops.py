"""Ray drop: how often a ray towards a surface gives no return, learned from a clip's own sweeps.

A file of points does not say where the sensor looked in vain. But a sensor turns evenly, fixed to its rig: of each
patch of directions, the sweep that is fuller than four fifths of the others shows the rays that look there (the grid).
Cast into the scene, the grid says where surfaces are; where fewer points than that were measured, rays were lost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, Int64
from numpy import ndarray

from instdrive_core.datasets.clip import Sweep
from instdrive_core.maths.streams import Stream, make_generator
from instdrive_core.progress import report
from instdrive_core.sweeps.cast import RayCaster, Returns
from instdrive_core.sweeps.offsets import MOST_SWEEPS, choose_evenly
from instdrive_core.sweeps.pattern import Pattern, trace_pattern
from instdrive_core.sweeps.rig import Rig

BANDS_M = np.array([5.0, 10.0, 20.0, 40.0, 80.0])
"""Distances between the bands in which the usual share of lost rays is measured."""
_WIDE, _HIGH = np.radians(2.0), np.radians(1.0)
"""Sides of a patch of directions."""
_FULL = 0.8
_LEAST, _MOST = 0.002, 0.95
"""Shares of lost rays."""
_SHRINKING = 1.0
"""Lost rays that a splat needs more than usual to count twice as much."""


@dataclass(frozen=True)
class RayDrop:
    """The rays of a sensor, and how many of them surfaces lose."""

    grid: Pattern
    """All rays, as far as sweeps show them: what never returned anything is not in it."""
    usual: Float32[ndarray, " b"]
    """Share of lost rays by band of distance."""
    factors: Float32[ndarray, " n"]
    """By splat of the scene: how many times as often it loses rays; 1 where no ray met it."""

    def of_rows(self, rows: Int64[ndarray, " m"]) -> RayDrop:
        """The drop of a scene that has these splats."""
        return replace(self, factors=self.factors[rows])

    def find_shares(
        self, rows: Int32[ndarray, " r"] | Int64[ndarray, " r"], ranges: Float32[ndarray, " r"]
    ) -> Float32[ndarray, " r"]:
        """Find how often rays are lost that meet splats at distances (metres)."""
        return np.clip(self.usual[np.searchsorted(BANDS_M, ranges)] * self.factors[rows], 0, _MOST)

    def draw_kept(self, returns: Returns, number: int) -> Bool[ndarray, " r"]:
        """Draw which rays return; equal numbers give equal draws, whatever else is in the scene."""
        kept = np.isfinite(returns.ranges)
        drawn = make_generator(0, Stream.LIDAR_DROP, number).random(len(kept), np.float32)
        kept[kept] = drawn[kept] >= self.find_shares(returns.rows[kept], returns.ranges[kept])
        return kept


def learn_drop(caster: RayCaster, rig: Rig, sweeps: Sequence[Sweep], place: Float64[ndarray, "3"]) -> RayDrop:
    """Learn the grid of a sensor, and which surfaces lose its rays.

    Args:
        caster: of the scene that was trained from the clip.
        rig: the clip's, in the scene's world.
        sweeps: at least one, that may train, in that world.
        place: of the sensor in the rig, metres.
    """
    chosen = choose_evenly(sweeps, MOST_SWEEPS)
    patterns = [trace_pattern(rig, sweep.time, sweep.load(), place) for sweep in chosen]
    grid = join_grid(patterns)
    patch = find_patches(grid.directions)
    size, bands = int(patch.max(initial=0)) + 1, len(BANDS_M) + 1
    hits, band_of, lost = [], [], []
    for done, (sweep, pattern) in enumerate(zip(chosen, patterns, strict=True)):
        returns = caster.cast(grid.aim(rig, sweep.time))
        met = np.flatnonzero(returns.rows >= 0)
        measured = np.bincount(np.minimum(find_patches(pattern.directions), size), minlength=size + 1)[:size]
        expected = np.bincount(patch[met], minlength=size)
        hits.append(returns.rows[met])
        band_of.append(np.searchsorted(BANDS_M, returns.ranges[met]))
        lost.append(np.maximum(1 - measured / np.maximum(expected, 1), -1)[patch[met]])
        report((done + 1) / len(chosen))
    rows, band, missing = np.concatenate(hits), np.concatenate(band_of), np.concatenate(lost)
    counts = np.maximum(np.bincount(band, minlength=bands), 1)
    usual = np.clip(np.bincount(band, missing, bands) / counts, _LEAST, _MOST)
    splats = len(caster.scene)
    seen, foreseen = np.bincount(rows, missing, splats), np.bincount(rows, usual[band], splats)
    factors = np.maximum(seen + _SHRINKING, 0) / (foreseen + _SHRINKING)
    return RayDrop(grid, usual.astype(np.float32), factors.astype(np.float32))


def join_grid(patterns: Sequence[Pattern]) -> Pattern:
    """Build the rays of a sensor from those of several sweeps that returned: each patch from one that fills it."""
    patches = [find_patches(pattern.directions) for pattern in patterns]
    size = max(int(patch.max(initial=0)) for patch in patches) + 1
    counts = np.stack([np.bincount(patch, minlength=size) for patch in patches])
    order = np.argsort(counts, axis=0, kind="stable")
    fullest = order[min(int(_FULL * len(patterns)), len(patterns) - 1)]
    kept = [fullest[patch] == number for number, patch in enumerate(patches)]
    pairs = list(zip(patterns, kept, strict=True))
    return replace(
        patterns[0],
        directions=np.concatenate([pattern.directions[mine] for pattern, mine in pairs]),
        delays=np.concatenate([pattern.delays[mine] for pattern, mine in pairs]),
        near=min(pattern.near for pattern in patterns),
        ranges=None,
    )


def find_patches(directions: Float32[ndarray, "r 3"]) -> Int64[ndarray, " r"]:
    """Find the patch of directions, in the rig's axes, that each lies in."""
    around = int(np.ceil(2 * np.pi / _WIDE))
    azimuths = np.arctan2(directions[:, 1], directions[:, 0]) + np.pi
    heights = np.arcsin(np.clip(directions[:, 2], -1, 1)) + np.pi / 2
    return (heights // _HIGH).astype(np.int64) * around + np.minimum(azimuths // _WIDE, around - 1).astype(np.int64)
