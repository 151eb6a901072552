"""What stands in a drive and what moves through it, from bare LiDAR points: ground, clusters, their motion.

Sweeps are first freed of what moved, so that all of them together can be clustered as one dense cloud; what moved is
clustered in each sweep by itself and carried to other times by the motion found between sweeps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, UInt32
from numpy import ndarray

from instdrive_core.datasets.clip import Clip, Sweep
from instdrive_core.masks.cluster_kind import FACADE, FIRST_THING, GROUND, NONE, VEGETATION, kinds_of_clusters
from instdrive_core.masks.cluster_motion import MovingCluster, with_velocities
from instdrive_core.masks.ground import GroundSurface, find_ground, is_ground
from instdrive_core.masks.lidar_clusters import absorbed, cluster, thinned
from instdrive_core.masks.point_shape import point_shape
from instdrive_core.masks.see_through import range_image, seen_through

MAX_DISTANCE = 90.0
"""Metres from the sensor up to which points are used."""
VOXEL = 0.1
"""Metres: the static cloud is thinned to one point per cell of this size."""
REACH, REACH_PER_METRE, MAX_REACH = 0.3, 0.01, 0.9
"""Metres within which static points hang together: right at the sensor, per metre of distance, at most."""
SWEEP_REACH = 0.4
"""The same right at the sensor, for points of a single sweep."""
WITNESSES = 2
"""Sweeps that must have looked through a point's place for it to have moved there."""
MOVED_SHARE = 0.25
"""Share of a cluster's points that must have moved for all of it to be moving."""
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


def build_lidar_scene(clip: Clip) -> LidarScene:
    """Find ground, standing and moving things in a clip's training sweeps; classes and cuboids are not looked at."""
    sweeps = [_near_points(clip, sweep) for sweep in clip.training_sweeps()]
    sweeps = [one for one in sweeps if len(one.points)]
    if not sweeps:
        return LidarScene(np.zeros((0, 3), np.float32), np.zeros(0, np.uint32), {}, None)
    every = np.concatenate([one.points for one in sweeps])
    ground = find_ground(every[thinned(every, VOXEL)])
    low = [is_ground(ground.above(one.points), one.distance) for one in sweeps]
    moved = _moving_clusters(sweeps, low)
    still = [~flat & (numbers < 0) for flat, numbers in zip(low, moved, strict=True)]
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
        _moving(sweeps, moved, first),
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


def _moving_clusters(sweeps: list[_Standing], low: list[Bool[ndarray, " n"]]) -> list[Int32[ndarray, " n"]]:
    """By sweep, the moving cluster of each point, -1 = ground or standing."""
    images = [range_image(one.points, one.position) for one in sweeps]
    witnesses = min(WITNESSES, len(sweeps) - 1)
    numbers = []
    for number, (one, flat) in enumerate(zip(sweeps, low, strict=True)):
        rows = np.flatnonzero(~flat)
        points = one.points[rows]
        votes = np.zeros(len(rows), np.int32)
        for other, image in enumerate(images):
            if other != number:
                votes += seen_through(points, image)
        reach = np.minimum(SWEEP_REACH + REACH_PER_METRE * one.distance[rows], MAX_REACH).astype(np.float32)
        clusters = cluster(points, reach)
        moved = (votes >= witnesses) & (witnesses > 0)
        share = np.bincount(clusters, moved) / np.maximum(np.bincount(clusters), 1)
        found = np.full(len(one.points), -1, np.int32)
        found[rows] = np.where((share > MOVED_SHARE)[clusters], clusters, -1)
        numbers.append(found)
    return numbers


def _moving(sweeps: list[_Standing], moved: list[Int32[ndarray, " n"]], first: int) -> dict[float, list[MovingCluster]]:
    """What moves, by sweep; the second LiDAR meets moving objects at another time, its points are left out."""
    by_time: dict[float, list[MovingCluster]] = {}
    for one, numbers in zip(sweeps, moved, strict=True):
        found = by_time[one.sweep.time] = []
        of_first_sensor = one.sensor == one.sensor.min()
        for number in np.unique(numbers[numbers >= 0]).tolist():
            points = one.points[(numbers == number) & of_first_sensor]
            if len(points) >= MIN_MOVING_POINTS:
                found.append(MovingCluster(first, points, np.zeros(3)))
                first += 1
    return with_velocities(by_time)


def _static(
    points: Float32[ndarray, "n 3"], sensors: Float64[ndarray, "s 3"], ground: GroundSurface
) -> tuple[Float32[ndarray, "m 3"], UInt32[ndarray, " m"]]:
    """What stands still, thinned, and its IDs."""
    points = points[thinned(points, VOXEL)]
    shape = point_shape(points)
    distance = np.linalg.norm(points[:, None, :2] - sensors[None, :, :2], axis=2).min(axis=1)
    reach = np.minimum(REACH + REACH_PER_METRE * distance, MAX_REACH).astype(np.float32)
    foliage = (shape.scatter > FOLIAGE).astype(np.int64)
    clusters = absorbed(points, cluster(points, reach, foliage), reach)
    kinds = kinds_of_clusters(points, clusters, shape, ground.above(points))
    ids = np.zeros(len(kinds), np.uint32)
    things = kinds == FIRST_THING
    ids[things] = FIRST_THING + np.arange(int(things.sum()))
    for kind in (FACADE, VEGETATION, NONE):
        ids[kinds == kind] = kind
    return points, ids[clusters]
