"""Rays cast into a scene: what each of them meets, and how far away."""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Float64, Int32, Int64
from numpy import ndarray

from instdrive_core.maths.activations import sigmoid
from instdrive_core.maths.rotations import normalize_quaternions
from instdrive_core.scene.scene import Scene, place_in_world
from instdrive_core.sweeps.kernels import LEAST_ALPHA, fill_tiles, find_tile_ranges, walk_rays, whiten

_TILE = math.radians(1.5)
_DRIFT = 0.4
"""Metres that the sensor may move among rays that are cast together."""
_SPAN = 0.05
"""Seconds that rays may be apart that are cast together, where things move."""
_STEP = 0.02
"""Seconds over which the speed of moving things is measured."""
_LARGEST_SIGMA = 30.0
"""Metres: larger splats are sky, not a surface."""


@dataclass(frozen=True)
class LidarRays:
    """Lines of sight, each at its own moment."""

    origins: Float64[ndarray, "r 3"]
    """World, metres."""
    directions: Float64[ndarray, "r 3"]
    """World, unit vectors."""
    times: Float64[ndarray, " r"]
    """Seconds as the scene counts them."""

    def __len__(self) -> int:
        return len(self.times)


@dataclass(frozen=True)
class Returns:
    """What rays met."""

    ranges: Float32[ndarray, " r"]
    """Metres; infinite where nothing returns."""
    rows: Int32[ndarray, " r"]
    """Splat of the scene at which half the light is gone; -1 where nothing returns."""
    opacities: Float32[ndarray, " r"]
    """Share of the light that is taken away."""


class RayCaster:
    """Casts rays into a scene at any time; what does not depend on the rays is computed once.

    Args:
        scene: with its tracks; deleted things are not in it.
        near: metres before which nothing returns, such as the car that carries the sensor.
        far: metres beyond which nothing returns.
    """

    def __init__(self, scene: Scene, near: float = 1.0, far: float = 200.0) -> None:
        gaussians = scene.gaussians
        self.scene, self.near, self.far = scene, near, far
        alphas = sigmoid(gaussians.opacity_logits.astype(np.float64)).astype(np.float32)
        sigmas = np.exp(gaussians.log_scales.max(axis=1, initial=-np.inf)).astype(np.float32)
        finite = np.isfinite(gaussians.means).all(axis=1) & np.isfinite(gaussians.quats).all(axis=1)
        self._rows = np.flatnonzero(finite & (alphas > LEAST_ALPHA) & (sigmas < _LARGEST_SIGMA))
        self._alphas = alphas[self._rows]
        with np.errstate(divide="ignore"):
            deviations = np.sqrt(2 * np.log(np.maximum(self._alphas / LEAST_ALPHA, 1)))
        self._reaches = (deviations * sigmas[self._rows]).astype(np.float32)
        self._means = gaussians.means[self._rows]
        self._quats = normalize_quaternions(gaussians.quats[self._rows]).astype(np.float32)
        self._log_scales = np.maximum(gaussians.log_scales[self._rows], np.float32(-12))
        self._nodes = scene.nodes[self._rows]
        self._matrices = whiten(self._quats, self._log_scales)

    def with_posed(self, scene: Scene) -> RayCaster:
        """Return a caster into the same Gaussians with other tracks or nodes; nothing is computed again."""
        posed = copy.copy(self)
        posed.scene, posed._nodes = scene, scene.nodes[self._rows]
        return posed

    def cast(self, rays: LidarRays) -> Returns:
        """Cast rays; groups that are near in place and time are cast together."""
        count = len(rays)
        ranges, rows = np.full(count, np.inf, np.float32), np.full(count, -1, np.int32)
        opacities = np.zeros(count, np.float32)
        for group in _split_rays(rays, bool(self._nodes.any())):
            ranges[group], rows[group], opacities[group] = self._cast_together(rays, group)
        return Returns(ranges, rows, opacities)

    def _cast_together(
        self, rays: LidarRays, group: Int64[ndarray, " g"]
    ) -> tuple[Float32[ndarray, " g"], Int32[ndarray, " g"], Float32[ndarray, " g"]]:
        time, middle = float(rays.times[group].mean()), rays.origins[group].mean(axis=0)
        origins = (rays.origins[group] - middle).astype(np.float32)
        directions = np.ascontiguousarray(rays.directions[group], np.float32)
        delays = (rays.times[group] - time).astype(np.float32)
        means, matrices, velocities, kept = self._place(time, middle)
        drift = float(np.linalg.norm(origins, axis=1).max(initial=0))
        reaches = self._reaches[kept] + np.float32(drift)
        if len(velocities):
            reaches += np.linalg.norm(velocities, axis=1) * np.abs(delays).max(initial=0)
        elevations = np.arcsin(np.clip(directions[:, 2], -1, 1))
        azimuths = np.arctan2(directions[:, 1], directions[:, 0]) + np.pi
        lowest = float(elevations.min())
        tiles_up = int((float(elevations.max()) - lowest) / _TILE) + 1
        around = math.ceil(2 * math.pi / _TILE)
        covered = find_tile_ranges(means, reaches, self.far, lowest, _TILE, tiles_up, around)
        tile_of_ray = (elevations - lowest) // _TILE * around + np.minimum(azimuths // _TILE, around - 1)
        tile_of_ray = np.clip(tile_of_ray.astype(np.int64), 0, tiles_up * around - 1)
        by_tile = np.argsort(tile_of_ray, kind="stable")
        counts = np.bincount(tile_of_ray, minlength=tiles_up * around)
        seen = np.flatnonzero(covered[:, 3])
        distances = np.linalg.norm(means, axis=1)
        order = seen[np.argsort(distances[seen], kind="stable")]
        starts, lists = fill_tiles(order, covered, counts > 0, around)
        ranges, hits = np.full(len(group), np.inf, np.float32), np.full(len(group), -1, np.int32)
        opacities = np.zeros(len(group), np.float32)
        walk_rays(
            np.r_[0, np.cumsum(counts)].astype(np.int64),
            by_tile,
            origins,
            directions,
            delays,
            starts,
            lists,
            means,
            matrices,
            self._alphas[kept],
            distances,
            velocities,
            self.near,
            self.far,
            ranges,
            hits,
            opacities,
        )
        rows = np.full(len(group), -1, np.int32)
        met = hits >= 0
        rows[met] = self._rows[kept[hits[met]]]
        return ranges, rows, opacities

    def _place(self, time: float, middle: Float64[ndarray, "3"]) -> tuple[ndarray, ndarray, ndarray, ndarray]:
        """Means around `middle`, matrices and velocities of the splats that are there at a time, and which they are."""
        if not self._nodes.any():
            means = (self._means - middle).astype(np.float32)
            return means, self._matrices, np.zeros((0, 3), np.float32), np.arange(len(means))
        poses, present = self.scene.find_node_poses(time)
        kept = np.flatnonzero(present[self._nodes])
        nodes = self._nodes[kept]
        means, quats = place_in_world(self._means[kept], self._quats[kept], nodes, poses)
        moved = np.flatnonzero(nodes)
        matrices = self._matrices[kept]
        matrices[moved] = whiten(normalize_quaternions(quats[moved]).astype(np.float32), self._log_scales[kept][moved])
        later, _ = self.scene.find_node_poses(time + _STEP)
        turn = later @ np.linalg.inv(poses)
        places = means[moved].astype(np.float64)
        velocities = np.zeros((len(kept), 3), np.float32)
        after = np.einsum("nij,nj->ni", turn[nodes[moved], :3, :3], places) + turn[nodes[moved], :3, 3]
        velocities[moved] = (after - places) / _STEP
        return (means - middle).astype(np.float32), matrices, velocities, kept


def _split_rays(rays: LidarRays, things_move: bool) -> list[Int64[ndarray, " g"]]:
    """Groups of rays by time, in each of which the sensor hardly moves."""
    if not len(rays):
        return []
    span = float(np.ptp(rays.times))
    drift = float(np.linalg.norm(np.ptp(rays.origins, axis=0)))
    parts = max(1, math.ceil(drift / _DRIFT), math.ceil(span / _SPAN) if things_move else 1)
    order = np.argsort(rays.times, kind="stable")
    return [part for part in np.array_split(order, min(parts, len(order))) if len(part)]
