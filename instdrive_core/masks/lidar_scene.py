"""What stands in a drive and what moves through it, from bare LiDAR points: ground, clusters, their motion.

Sweeps are first freed of what moved, so that all of them together can be clustered as one dense cloud; what moved is
clustered in each sweep by itself and carried to other times by the motion found between sweeps.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float32, Float64, UInt32
from numpy import ndarray

from instdrive_core.datasets.clip import Clip, Sweep
from instdrive_core.masks.cluster_kind import FACADE, FIRST_THING, GROUND, NONE, VEGETATION, kinds_of_clusters
from instdrive_core.masks.cluster_motion import MovingCluster, completed
from instdrive_core.masks.cluster_parts import joined_splinters, joined_vehicles
from instdrive_core.masks.ground import GroundSurface, find_ground, is_ground
from instdrive_core.masks.lidar_clusters import absorbed, cluster, thinned
from instdrive_core.masks.moving_points import ClusteredSweep, moving_clusters
from instdrive_core.masks.point_shape import point_shape

MAX_DISTANCE = 90.0
"""Metres from the sensor up to which points are used."""
VOXEL = 0.1
"""Metres: the static cloud is thinned to one point per cell of this size."""
REACH, REACH_PER_METRE, MAX_REACH = 0.3, 0.01, 0.9
"""Metres within which static points hang together: right at the sensor, per metre of distance, at most."""
SWEEP_REACH = 0.4
"""The same right at the sensor, for points of a single sweep."""
MIRRORED = 0.3
"""Metres below the ground from which on points are mirror images."""
MIN_MOVING_POINTS = 12
FOLIAGE = 0.42
"""Scatter from which on points are foliage, which nothing else hangs together with."""


@dataclass(frozen=True)
class LidarScene:
    """Points with IDs: `GROUND`, `FACADE`, `VEGETATION`, and a number from `FIRST_THING` on for each thing."""

    points: Float32[ndarray, "n 3"]
    """What stands still, in the world."""
    ids: UInt32[ndarray, " n"]
    moving: dict[float, list[MovingCluster]]
    """What moves, by time of the sweep that saw it."""
    ground: GroundSurface | None

    def things(self) -> dict[int, Float32[ndarray, "k 3"]]:
        """Points of each thing that stands still."""
        order = np.argsort(self.ids, kind="stable")
        order = order[np.searchsorted(self.ids[order], FIRST_THING) :]
        starts = np.flatnonzero(np.diff(self.ids[order].astype(np.int64), prepend=0))
        parts = np.split(order, starts[1:])
        return {int(self.ids[rows[0]]): self.points[rows] for rows in parts if len(rows)}

    def moving_at(self, time: float) -> dict[int, Float32[ndarray, "k 3"]]:
        """Points of each moving thing, carried to `time` from the nearest sweep."""
        if not self.moving:
            return {}
        sweep_time = min(self.moving, key=lambda known: (abs(known - time), known))
        lag = time - sweep_time
        return {one.id: one.points + (one.velocity * lag).astype(np.float32) for one in self.moving[sweep_time]}


@dataclass(frozen=True)
class _Standing:
    """One sweep's points near the sensor; `distance` in metres from it."""

    sweep: Sweep
    points: Float32[ndarray, "n 3"]
    sensor: ndarray
    distance: Float32[ndarray, " n"]
    position: Float64[ndarray, "3"]

    def above_ground(self, ground: GroundSurface) -> _Standing:
        """Without what lies below the ground: mirror images."""
        kept = ground.above(self.points) > -MIRRORED
        return replace(self, points=self.points[kept], sensor=self.sensor[kept], distance=self.distance[kept])


def build_lidar_scene(clip: Clip) -> LidarScene:
    """Find ground, standing and moving things in a clip's training sweeps; classes and cuboids are not looked at."""
    sweeps = [_near_points(clip, sweep) for sweep in clip.training_sweeps()]
    sweeps = [one for one in sweeps if len(one.points)]
    if not sweeps:
        return LidarScene(np.zeros((0, 3), np.float32), np.zeros(0, np.uint32), {}, None)
    every = np.concatenate([one.points for one in sweeps])
    ground = find_ground(every[thinned(every, VOXEL)])
    sweeps = [one.above_ground(ground) for one in sweeps]
    low = [is_ground(ground.above(one.points), one.distance) for one in sweeps]
    clustered = [_clustered(one, flat, ground) for one, flat in zip(sweeps, low, strict=True)]
    moved = moving_clusters(clustered)
    still = [
        (one.clusters >= 0) & ~moves[np.maximum(one.clusters, 0)] for one, moves in zip(clustered, moved, strict=True)
    ]
    points, ids = _static(
        np.concatenate([one.points[kept] for one, kept in zip(sweeps, still, strict=True)]),
        np.array([one.position for one in sweeps]),
        ground,
    )
    floor = np.concatenate([one.points[flat] for one, flat in zip(sweeps, low, strict=True)])
    floor = floor[thinned(floor, VOXEL)]
    first = max(FIRST_THING, int(ids.max(initial=0)) + 1)
    return LidarScene(
        np.concatenate([floor, points]),
        np.concatenate([np.full(len(floor), GROUND, np.uint32), ids]),
        _moving(sweeps, clustered, moved, first),
        ground,
    )


def _near_points(clip: Clip, sweep: Sweep) -> _Standing:
    found = sweep.load()
    position = sensor_position(clip, sweep.time)
    distance = np.linalg.norm(found.points - position.astype(np.float32), axis=1)
    near = distance < MAX_DISTANCE
    return _Standing(sweep, found.points[near], found.sensor[near], distance[near], position)


def sensor_position(clip: Clip, time: float) -> Float64[ndarray, "3"]:
    """Where the LiDAR is, roughly: amid the cameras at the nearest time."""
    views = [frame.view for frame in clip.frames]
    nearest = min((view.time for view in views), key=lambda other: abs(other - time))
    return np.mean([view.camera.position for view in views if view.time == nearest], axis=0)


def _clustered(one: _Standing, flat: Bool[ndarray, " n"], ground: GroundSurface) -> ClusteredSweep:
    rows = np.flatnonzero(~flat)
    points = one.points[rows]
    reach = np.minimum(SWEEP_REACH + REACH_PER_METRE * one.distance[rows], MAX_REACH).astype(np.float32)
    clusters = np.full(len(one.points), -1, np.int32)
    clusters[rows] = joined_vehicles(points, cluster(points, reach), ground.above(points))
    return ClusteredSweep(one.sweep.time, one.position, one.points, clusters)


def _moving(
    sweeps: list[_Standing], clustered: list[ClusteredSweep], moved: list[Bool[ndarray, " c"]], first: int
) -> dict[float, list[MovingCluster]]:
    """What moves, by sweep; the second LiDAR meets moving objects at another time, its points are left out."""
    by_time: dict[float, list[MovingCluster]] = {}
    for one, hanging, moves in zip(sweeps, clustered, moved, strict=True):
        found = by_time[one.sweep.time] = []
        of_first_sensor = one.sensor == one.sensor.min()
        for number in np.flatnonzero(moves).tolist():
            points = one.points[(hanging.clusters == number) & of_first_sensor]
            if len(points) >= MIN_MOVING_POINTS:
                found.append(MovingCluster(first, points, np.zeros(3)))
                first += 1
    return completed(by_time)


def _static(
    points: Float32[ndarray, "n 3"], sensors: Float64[ndarray, "s 3"], ground: GroundSurface
) -> tuple[Float32[ndarray, "m 3"], UInt32[ndarray, " m"]]:
    """What stands still, thinned, and its IDs."""
    points = points[thinned(points, VOXEL)]
    shape = point_shape(points)
    distance = np.linalg.norm(points[:, None, :2] - sensors[None, :, :2], axis=2).min(axis=1)
    reach = np.minimum(REACH + REACH_PER_METRE * distance, MAX_REACH).astype(np.float32)
    foliage = (shape.scatter > FOLIAGE).astype(np.int64)
    above = ground.above(points)
    clusters = joined_splinters(points, absorbed(points, cluster(points, reach, foliage), reach), reach)
    kinds = kinds_of_clusters(points, clusters, shape, above)
    things = kinds[clusters] == FIRST_THING
    whole = joined_vehicles(points, np.where(things, clusters, -1).astype(np.int32), above)
    clusters = np.where(things, len(kinds) + whole, clusters)
    kinds = np.append(kinds, np.full(int(whole.max(initial=-1)) + 1, FIRST_THING, np.uint32))
    ids = np.zeros(len(kinds), np.uint32)
    things = kinds == FIRST_THING
    ids[things] = FIRST_THING + np.arange(int(things.sum()))
    for kind in (GROUND, FACADE, VEGETATION, NONE):
        ids[kinds == kind] = kind
    return points, ids[clusters]
