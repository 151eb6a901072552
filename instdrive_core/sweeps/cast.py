"""Rays cast into a scene: what each of them meets, and how far away."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, Int64, Integer
from numpy import ndarray

from instdrive_core.maths.activations import sigmoid
from instdrive_core.maths.rotations import normalize_quaternions
from instdrive_core.scene.scene import Scene, place_in_world
from instdrive_core.sweeps.kernels import HELD, LEAST_ALPHA, walk_rays
from instdrive_core.sweeps.tiles import fill_tiles, find_tile_ranges, find_velocities, whiten

_TILE = math.radians(2.0)
_DRIFT = 0.6
"""Metres that the sensor may move among rays that are cast together."""
_SPAN = 0.1
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


@dataclass(frozen=True)
class Met:
    """The splats that each ray meets, near ones first; the rest of a row is empty."""

    depths: Float32[ndarray, "r h"]
    """Metres."""
    weights: Float32[ndarray, "r h"]
    """Share of the light that each takes away; 0 where there is none."""
    rows: Int32[ndarray, "r h"]
    """Splats of the scene; -1 where there is none."""


@dataclass(frozen=True)
class _Placed:
    """Splats around a place; those that move as they are at a time."""

    means: Float32[ndarray, "n 3"]
    matrices: Float32[ndarray, "n 3 3"]
    velocities: Float32[ndarray, "m 3"]
    """m/s; none where nothing moves."""
    moved: Int64[ndarray, " k"]
    """Those that move."""
    present: Bool[ndarray, " k"]
    """Whether they are there."""


class RayCaster:
    """Casts rays into a scene at any time; what does not depend on the rays is computed once.

    Args:
        scene: with its tracks; deleted things are not in it.
        near: metres before which nothing returns, such as the car that carries the sensor.
        far: metres beyond which nothing returns.
        offsets: metres, by splat of the scene, along a ray from where it is densest to the surface that it stands for;
            None: none is known.
    """

    def __init__(
        self, scene: Scene, near: float = 1.0, far: float = 200.0, offsets: Float32[ndarray, " n"] | None = None
    ) -> None:
        gaussians = scene.gaussians
        self.scene, self.near, self.far = scene, near, far
        alphas = sigmoid(gaussians.opacity_logits.astype(np.float64)).astype(np.float32)
        sigmas = np.exp(gaussians.log_scales.max(axis=1, initial=-np.inf)).astype(np.float32)
        finite = np.isfinite(gaussians.means).all(axis=1) & np.isfinite(gaussians.quats).all(axis=1)
        self._rows = np.flatnonzero(finite & (alphas > LEAST_ALPHA) & (sigmas < _LARGEST_SIGMA))
        self._alphas = alphas[self._rows]
        with np.errstate(divide="ignore"):
            deviations = np.sqrt(2 * np.log(np.maximum(self._alphas / LEAST_ALPHA, 1)))
        self._deviations = deviations.astype(np.float32)
        self._means = gaussians.means[self._rows]
        self._quats = normalize_quaternions(gaussians.quats[self._rows]).astype(np.float32)
        self._log_scales = np.maximum(gaussians.log_scales[self._rows], np.float32(-12))
        self._nodes = scene.nodes[self._rows]
        self._matrices = whiten(self._quats, self._log_scales)
        self._offsets = np.zeros(len(self._rows), np.float32) if offsets is None else offsets[self._rows]

    def with_posed(self, scene: Scene) -> RayCaster:
        """Return a caster into the same Gaussians with other tracks or nodes; nothing is computed again."""
        posed = copy.copy(self)
        posed.scene, posed._nodes = scene, scene.nodes[self._rows]
        return posed

    def cast(self, rays: LidarRays) -> Returns:
        """Cast rays; groups that are near in place and time are cast together."""
        return self._walk(rays, lists=False)[0]

    def list_met(self, rays: LidarRays) -> Met:
        """List all splats that rays meet up to a little behind where half the light is gone."""
        return self._walk(rays, lists=True)[1]

    def _walk(self, rays: LidarRays, lists: bool) -> tuple[Returns, Met]:
        """What rays return, and what they meet where that `lists`; else nothing is listed."""
        found = _make_room(len(rays), lists)
        write: Any = walk_rays
        for group, arguments in self._prepare_groups(rays):
            of_group = _make_room(len(group), lists)
            write(*arguments, *of_group)
            for whole, part in zip(found, of_group, strict=True):
                if len(whole):
                    whole[group] = part
        ranges, hits, opacities, depths, weights, rows = found
        return Returns(ranges, self._name_rows(hits), opacities), Met(depths, weights, self._name_rows(rows))

    def _name_rows(self, hits: Int32[ndarray, "*s"]) -> Int32[ndarray, "*s"]:
        """Rows of the scene for those of the caster."""
        return np.where(hits >= 0, self._rows[np.maximum(hits, 0)] if len(self._rows) else -1, -1).astype(np.int32)

    def _prepare_groups(self, rays: LidarRays) -> Iterator[tuple[Int64[ndarray, " g"], Any]]:
        """Groups of rays, and for each the arguments of the kernels up to what they write."""
        if not len(rays):
            return
        middle = rays.origins.mean(axis=0)
        placed = self._place_still(middle)
        for group in _split_rays(rays, len(placed.moved) > 0):
            time = float(rays.times[group].mean())
            self._place_moving(placed, time, middle)
            yield group, self._bin(placed, rays, group, time, middle)

    def _bin(
        self, placed: _Placed, rays: LidarRays, group: Int64[ndarray, " g"], time: float, middle: Float64[ndarray, "3"]
    ) -> Any:
        """Bin rays and splats into tiles of directions."""
        here = rays.origins[group].mean(axis=0)
        origins = (rays.origins[group] - middle).astype(np.float32)
        directions = np.ascontiguousarray(rays.directions[group], np.float32)
        delays = (rays.times[group] - time).astype(np.float32)
        drift = np.linalg.norm(rays.origins[group] - here, axis=1).max(initial=0)
        spares = np.full(len(placed.means), drift, np.float32)
        if len(placed.moved):
            speeds = np.linalg.norm(placed.velocities[placed.moved], axis=1)
            spares[placed.moved] += speeds * np.abs(delays).max(initial=0)
            spares[placed.moved[~placed.present]] = -1
        elevations = np.arcsin(np.clip(directions[:, 2], -1, 1))
        azimuths = np.arctan2(directions[:, 1], directions[:, 0]) + np.pi
        lowest = float(elevations.min())
        tiles_up = int((float(elevations.max()) - lowest) / _TILE) + 1
        around = math.ceil(2 * math.pi / _TILE)
        tile_of_ray = (elevations - lowest) // _TILE * around + np.minimum(azimuths // _TILE, around - 1)
        tile_of_ray = np.clip(tile_of_ray.astype(np.int64), 0, tiles_up * around - 1)
        by_tile = _sort_rows(tile_of_ray)
        counts = np.bincount(tile_of_ray, minlength=tiles_up * around)
        shift = (here - middle).astype(np.float32)
        covered, distances = find_tile_ranges(
            placed.means,
            placed.matrices,
            self._deviations,
            spares,
            shift,
            counts > 0,
            self.far,
            lowest,
            _TILE,
            tiles_up,
            around,
        )
        seen = np.flatnonzero(covered[:, 3])
        order = seen[_sort_rows(distances[seen].view(np.uint32))]  # of floats above 0 the bits rise, too
        starts, lists = fill_tiles(order, covered, counts > 0, around)
        return (
            np.r_[0, np.cumsum(counts)].astype(np.int64), by_tile, origins, directions, delays, starts, lists,
            placed.means, placed.matrices, self._alphas, self._offsets, distances, placed.velocities, self.near,
            self.far,
        )  # fmt: skip

    def _place_still(self, middle: Float64[ndarray, "3"]) -> _Placed:
        """All splats around `middle`; room for those that move."""
        means, moved = (self._means - middle).astype(np.float32), np.flatnonzero(self._nodes)
        if not len(moved):
            still = np.zeros((0, 3), np.float32)
            return _Placed(means, self._matrices, still, moved, np.ones(0, bool))
        velocities = np.zeros((len(means), 3), np.float32)
        return _Placed(means, self._matrices.copy(), velocities, moved, np.ones(len(moved), bool))

    def _place_moving(self, placed: _Placed, time: float, middle: Float64[ndarray, "3"]) -> None:
        """Write means, matrices and velocities of what moves, as it is at a time."""
        moved = placed.moved
        if not len(moved):
            return
        poses, present = self.scene.find_node_poses(time)
        nodes = self._nodes[moved]
        placed.present[:] = present[nodes]
        means, quats = place_in_world(self._means[moved], self._quats[moved], nodes, poses)
        placed.means[moved] = means - middle
        placed.matrices[moved] = whiten(normalize_quaternions(quats).astype(np.float32), self._log_scales[moved])
        later, _ = self.scene.find_node_poses(time + _STEP)
        turns = later @ np.linalg.inv(poses)
        placed.velocities[moved] = find_velocities(means, nodes, turns[:, :3], _STEP)


def _make_room(count: int, lists: bool) -> tuple[ndarray, ...]:
    """Room for what `walk_rays` writes of so many rays, as it is of rays that meet nothing.

    Without `lists` the last three, which say what rays meet, are empty.
    """
    shape = count if lists else 0, HELD
    return (
        np.full(count, np.inf, np.float32),
        np.full(count, -1, np.int32),
        np.zeros(count, np.float32),
        np.zeros(shape, np.float32),
        np.zeros(shape, np.float32),
        np.full(shape, -1, np.int32),
    )


def _sort_rows(keys: Integer[ndarray, " n"]) -> Int64[ndarray, " n"]:
    """Indices that sort whole numbers below 2^32, equal ones as they come: numbers that hold both sort quickly."""
    joined = (keys.astype(np.uint64) << np.uint64(32)) | np.arange(len(keys), dtype=np.uint64)
    joined.sort()
    return (joined & np.uint64(0xFFFFFFFF)).astype(np.int64)


def _split_rays(rays: LidarRays, things_move: bool) -> list[Int64[ndarray, " g"]]:
    """Groups of rays by time, in each of which the sensor hardly moves."""
    if not len(rays):
        return []
    span = float(np.ptp(rays.times))
    drift = float(np.linalg.norm(np.ptp(rays.origins, axis=0)))
    parts = max(1, math.ceil(drift / _DRIFT), math.ceil(span / _SPAN) if things_move else 1)
    order = np.argsort(rays.times, kind="stable")
    return [part for part in np.array_split(order, min(parts, len(order))) if len(part)]
