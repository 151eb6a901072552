"""Standing and moving things of a drive from bare LiDAR points: ground, clusters, their motion.

Sweeps are first freed of what moved, so that all of them together can be clustered as one dense cloud; what moved is
clustered in each sweep by itself and carried to other times by the motion found between sweeps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, UInt32
from numpy import ndarray
from scipy.spatial import KDTree

from instdrive_core.datasets.clip import Clip, Sweep
from instdrive_core.masks.image.beams import estimate_beams, estimate_sensor_position
from instdrive_core.masks.lidar.cluster_kind import (
    BACKDROP,
    FACADE,
    GROUND,
    NONE,
    THING,
    VEGETATION,
    WALL,
    classify_clusters,
)
from instdrive_core.masks.lidar.cluster_motion import MovingCluster, complete_clusters
from instdrive_core.masks.lidar.cluster_parts import claim_insides, join_splinters, join_vehicle_parts, part_queues
from instdrive_core.masks.lidar.clusters import absorb_small_clusters, cluster_points, thin_rows
from instdrive_core.masks.lidar.ground import GroundSurface, find_ground, is_ground
from instdrive_core.masks.lidar.ground_pieces import part_ground
from instdrive_core.masks.lidar.moving_points import ClusteredSweep, find_moving_clusters
from instdrive_core.masks.lidar.point_shape import compute_point_shape
from instdrive_core.masks.lidar.walls import join_wide, part_walls, recognize_stuff
from instdrive_core.scene.camera import PhotoLag

MAX_DISTANCE = 90.0
"""Metres from the sensor up to which points are used."""
VOXEL = 0.1
"""Metres: the static cloud is thinned to one point per cell of this size."""
REACH, REACH_PER_METRE, MAX_REACH = 0.3, 0.01, 0.9
"""Metres within which static points hang together: right at the sensor, per metre of distance, at most."""
SWEEP_REACH = 0.4
"""Metres within which points of a single sweep hang together, right at the sensor."""
MIRRORED = 0.3
"""Metres below the ground from which on points are mirror images."""
MIN_WIDE_POINTS = 300
"""Facades of fewer points, far away mostly, share an ID; so do walls, plants and pieces of the backdrop."""
MIN_MOVING_POINTS = 12
LOWEST_FOLIAGE = 1.0
"""Metres above the ground: what lies lower is as likely part of a car."""
FOLIAGE = 0.42
"""Scatter from which on points are foliage, which nothing else hangs together with."""


@dataclass(frozen=True)
class LidarScene:
    """Points with IDs: 1 for the ground, or one for each of its pieces, then one for each facade, wall, plant, piece of
    the backdrop and thing."""

    points: Float32[ndarray, "n 3"]
    """Points of what stands still, in the world."""
    ids: UInt32[ndarray, " n"]
    kinds: UInt32[ndarray, " i"]
    """`GROUND`, `FACADE`, `WALL`, `VEGETATION`, `BACKDROP` or `THING` by ID of what stands still, ascending; the
    first ID is nothing."""
    moving: dict[float, list[MovingCluster]]
    """Moving clusters by time of the sweep that saw them."""

    @property
    def first_standing(self) -> int:
        """The lowest ID of what stands on the ground."""
        return int(np.searchsorted(self.kinds, GROUND, side="right"))

    @property
    def first_thing(self) -> int:
        """The lowest ID of a thing."""
        return int(np.searchsorted(self.kinds, THING))

    @property
    def ground(self) -> Float32[ndarray, "k 3"]:
        """The points of the ground."""
        return self.points[self.kinds[self.ids] == GROUND]

    def part_ground(self, path: Float64[ndarray, "s 3"]) -> LidarScene:
        """Give each piece of the ground that kerbs part an ID of its own, the largest one 1.

        What lies right at a kerb gets none: photos tell better on which side. `path` is the sensor's, metres.
        """
        pieces = part_ground(self.ground, path)
        more = pieces.count - 1
        ids = np.where(self.ids > GROUND, self.ids + more, self.ids).astype(np.uint32)
        low = self.ids == GROUND
        ids[low] = np.maximum(pieces.find(self.points[low]) + GROUND, NONE)
        moving = {time: [replace(one, id=one.id + more) for one in found] for time, found in self.moving.items()}
        return LidarScene(self.points, ids, np.insert(self.kinds, GROUND, np.full(more, GROUND, np.uint32)), moving)

    def group_things(self) -> dict[int, Float32[ndarray, "k 3"]]:
        """Group the points of each thing that stands still."""
        order = np.argsort(self.ids, kind="stable")
        order = order[np.searchsorted(self.ids[order], self.first_thing) :]
        starts = np.flatnonzero(np.diff(self.ids[order].astype(np.int64), prepend=0))
        parts = np.split(order, starts[1:])
        return {int(self.ids[rows[0]]): self.points[rows] for rows in parts if len(rows)}

    def place_moving(self, time: float, photo_lag: PhotoLag | None = None) -> dict[int, Float32[ndarray, "k 3"]]:
        """Place the points of each moving thing, as a photo of the step at `time` shows them: carried from the nearest
        sweep."""
        if not self.moving:
            return {}
        sweep_time = min(self.moving, key=lambda known: (abs(known - time), known))
        placed = {}
        for one in self.moving[sweep_time]:
            passed = time - sweep_time + (0 if photo_lag is None else photo_lag.find(one.points.mean(axis=0)))
            placed[one.id] = one.points + (one.velocity * passed).astype(np.float32)
        return placed


@dataclass(frozen=True)
class _Standing:
    """One sweep's points near the sensor; `distance` in metres from it."""

    sweep: Sweep
    points: Float32[ndarray, "n 3"]
    sensor: ndarray
    distance: Float32[ndarray, " n"]
    position: Float64[ndarray, "3"]

    def above_ground(self, ground: GroundSurface) -> _Standing:
        """Drop what lies below the ground: mirror images."""
        kept = ground.compute_heights_above(self.points) > -MIRRORED
        return replace(self, points=self.points[kept], sensor=self.sensor[kept], distance=self.distance[kept])


def build_lidar_scene(clip: Clip, posts_apart: bool = True) -> LidarScene:
    """Find ground, standing and moving things in a clip's training sweeps; classes and cuboids are not looked at.

    Args:
        clip: the clip.
        posts_apart: posts, signs and lamps more than 30 m away are things; else they are parts of walls.
    """
    sweeps = [_select_near_points(clip, sweep) for sweep in clip.training_sweeps]
    sweeps = [one for one in sweeps if len(one.points)]
    if not sweeps:
        return LidarScene(np.zeros((0, 3), np.float32), np.zeros(0, np.uint32), np.arange(2, dtype=np.uint32), {})
    every = np.concatenate([one.points for one in sweeps])
    ground = find_ground(every[thin_rows(every, VOXEL)])
    sweeps = [one.above_ground(ground) for one in sweeps]
    low = [is_ground(ground.compute_heights_above(one.points), one.distance) for one in sweeps]
    clustered = [_cluster_sweep(one, flat, ground) for one, flat in zip(sweeps, low, strict=True)]
    moved = find_moving_clusters(clustered)
    still = [one.belong_to(~moves) for one, moves in zip(clustered, moved, strict=True)]
    points, ids, kinds = _gather_static(
        np.concatenate([one.points[kept] for one, kept in zip(sweeps, still, strict=True)]),
        np.array([one.position for one in sweeps]),
        ground,
        estimate_beams(clip).upper_end,
        posts_apart,
    )
    floor = np.concatenate([one.points[flat] for one, flat in zip(sweeps, low, strict=True)])
    floor = floor[thin_rows(floor, VOXEL)]
    return LidarScene(
        np.concatenate([floor, points]),
        np.concatenate([np.full(len(floor), GROUND, np.uint32), ids]),
        kinds,
        _gather_moving(sweeps, clustered, moved, len(kinds)),
    )


def _select_near_points(clip: Clip, sweep: Sweep) -> _Standing:
    found = sweep.load()
    position = estimate_sensor_position(clip, sweep.time)
    distance = np.linalg.norm(found.points - position.astype(np.float32), axis=1)
    near = distance < MAX_DISTANCE
    return _Standing(sweep, found.points[near], found.sensor[near], distance[near], position)


def _cluster_sweep(one: _Standing, flat: Bool[ndarray, " n"], ground: GroundSurface) -> ClusteredSweep:
    rows = np.flatnonzero(~flat)
    points = one.points[rows]
    reach = np.minimum(SWEEP_REACH + REACH_PER_METRE * one.distance[rows], MAX_REACH).astype(np.float32)
    clusters = np.full(len(one.points), -1, np.int32)
    clusters[rows] = join_vehicle_parts(points, cluster_points(points, reach), ground.compute_heights_above(points))
    return ClusteredSweep(one.sweep.time, one.position, one.points, clusters)


def _gather_moving(
    sweeps: list[_Standing], clustered: list[ClusteredSweep], moved: list[Bool[ndarray, " _"]], first: int
) -> dict[float, list[MovingCluster]]:
    """Gather what moves, by sweep. The second LiDAR meets moving objects at another time: its points are left out."""
    by_time: dict[float, list[MovingCluster]] = {}
    for one, hanging, moves in zip(sweeps, clustered, moved, strict=True):
        found = by_time[one.sweep.time] = []
        of_first_sensor = one.sensor == one.sensor.min()
        for number in np.flatnonzero(moves).tolist():
            points = one.points[(hanging.clusters == number) & of_first_sensor]
            if len(points) >= MIN_MOVING_POINTS:
                found.append(MovingCluster(first, points, np.zeros(3)))
                first += 1
    return complete_clusters(by_time)


def _gather_static(
    points: Float32[ndarray, "n 3"],
    sensors: Float64[ndarray, "s 3"],
    ground: GroundSurface,
    highest: float,
    posts_apart: bool,
) -> tuple[Float32[ndarray, "m 3"], UInt32[ndarray, " m"], UInt32[ndarray, " i"]]:
    """Gather what stands still, thinned, with its IDs and the kind of each ID."""
    points = points[thin_rows(points, VOXEL)]
    shape = compute_point_shape(points)
    distance = KDTree(sensors[:, :2]).query(points[:, :2])[0]
    reach = np.minimum(REACH + REACH_PER_METRE * distance, MAX_REACH).astype(np.float32)
    above = ground.compute_heights_above(points)
    foliage = ((shape.scatter > FOLIAGE) & (above > LOWEST_FOLIAGE)).astype(np.int64)
    clusters = join_splinters(
        points, absorb_small_clusters(points, cluster_points(points, reach, foliage), reach), reach
    )
    clusters = part_queues(points, clusters, above)
    kinds = classify_clusters(points, clusters, shape, above)
    things = kinds[clusters] == THING
    whole = join_vehicle_parts(points, np.where(things, clusters, -1).astype(np.int32), above)
    clusters = np.where(things, len(kinds) + whole, clusters).astype(np.int32)
    first = len(kinds)
    kinds = np.append(kinds, np.full(int(whole.max(initial=-1)) + 1, THING, np.uint32))
    clusters = claim_insides(points, clusters, range(first, len(kinds)), above)
    clusters, kinds = part_walls(points, clusters, kinds, above, _compute_ceiling(points, sensors, above, highest))
    distance = distance.astype(np.float32)
    kinds = recognize_stuff(points, clusters, kinds, above, distance, posts_apart)
    clusters = join_wide(points, clusters, kinds, distance)
    return points, *_number_points(*_merge_scraps(kinds, clusters))


def _compute_ceiling(
    points: Float32[ndarray, "n 3"], sensors: Float64[ndarray, "s 3"], above: Float32[ndarray, " n"], highest: float
) -> Float32[ndarray, " n"]:
    """Compute how many metres above the ground the highest beam, at so many degrees, passes each point."""
    distance, nearest = KDTree(sensors[:, :2]).query(points[:, :2])
    passes = sensors[nearest, 2] + np.asarray(distance) * math.tan(math.radians(highest))
    return (passes - points[:, 2] + above).astype(np.float32)


def _merge_scraps(
    kinds: UInt32[ndarray, " c"], clusters: Int32[ndarray, " n"]
) -> tuple[UInt32[ndarray, " c"], Int32[ndarray, " n"]]:
    """Merge scraps: kinds and clusters with all small clusters of facades in one, so those of walls, and of plants."""
    small = np.bincount(clusters, minlength=len(kinds)) < MIN_WIDE_POINTS
    joined = np.arange(len(kinds), dtype=np.int32)
    for kind in (FACADE, WALL, VEGETATION, BACKDROP):
        scraps = np.flatnonzero(small & (kinds == kind))
        joined[scraps] = scraps[:1]
    return kinds, joined[clusters]


def _number_points(
    kinds: UInt32[ndarray, " c"], clusters: Int32[ndarray, " n"]
) -> tuple[UInt32[ndarray, " n"], UInt32[ndarray, " i"]]:
    """Number points, wide clusters before things, with the kind of each ID."""
    order = np.argsort(kinds, kind="stable")
    order = order[
        (kinds[order] != NONE) & (kinds[order] != GROUND) & (np.bincount(clusters, minlength=len(kinds))[order] > 0)
    ]
    ids = np.where(kinds == GROUND, GROUND, NONE).astype(np.uint32)
    ids[order] = np.arange(GROUND + 1, GROUND + 1 + len(order))
    return ids[clusters], np.concatenate([np.array([NONE, GROUND], np.uint32), kinds[order]])
