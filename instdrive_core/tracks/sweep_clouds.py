"""What the finder keeps of each sweep: points above the ground and near the sensor, with the time of each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Float64, UInt8
from numpy import ndarray

from instdrive_core.datasets.clip import Clip, Sweep, SweepPoints
from instdrive_core.masks.lidar.clusters import thin_rows
from instdrive_core.masks.lidar.ground import GroundSurface, find_ground
from instdrive_core.tracks.range_images import SweepImage, build_sweep_image

NEAREST, FARTHEST = 2.0, 85.0
"""Metres from the sensor within which points are used."""
FLOOR, FLOOR_PER_METRE, CEILING = 0.25, 0.002, 4.5
"""Metres above the ground: the lowest point used right at the sensor, more per metre of range, and the highest."""
SPACING = 0.07
"""Metres: each LiDAR's points are thinned to one per cell of this size."""
GROUND_SPACING = 0.2
"""Limit for the points below which the ground is found."""
LATEST = 1.0
"""Seconds that a point's time may lie off its sweep's; beyond, the times are those of another clock."""
BEARINGS = 72
"""Directions around the sensor by which the time of the turn is kept."""


@dataclass(frozen=True, eq=False)
class SweepCloud:
    """One sweep's points that may be of something that moves."""

    index: int
    time: float
    """Time of the time step, seconds as the clip counts them."""
    position: Float64[ndarray, "3"]
    """Rough place of the sensor."""
    points: Float32[ndarray, "n 3"]
    """Metres, x and y in the world, z above the ground."""
    heights: Float32[ndarray, " n"]
    """Height of the ground under each point, z in the world."""
    distance: Float32[ndarray, " n"]
    """Metres from the sensor."""
    sensor: UInt8[ndarray, " n"]
    """Which LiDAR saw each point."""
    times: Float64[ndarray, " n"]
    """Time of each point, seconds; that of the time step where the sweep has no times of its own."""
    turn: Float64[ndarray, " b"]
    """When the first LiDAR looked in each direction (`compute_bearings`), seconds."""
    images: tuple[SweepImage, ...]
    """What each LiDAR met, the ground and far points included."""

    def time_towards(self, place: Float64[ndarray, "2"]) -> float:
        """When the first LiDAR, which the cameras follow, looked towards a place on the ground."""
        return float(self.turn[compute_bearings(place - self.position[:2])])


def compute_bearings(offset: Float64[ndarray, "... 2"]) -> ndarray:
    """Number of the direction of offsets along the ground, 0 to `BEARINGS` - 1."""
    angle = np.arctan2(offset[..., 1], offset[..., 0]) + np.pi
    return np.asarray((angle / (2 * np.pi) * BEARINGS).astype(np.int64) % BEARINGS)


def gather_clouds(clip: Clip, sweeps: tuple[Sweep, ...]) -> tuple[list[SweepCloud], list[str]]:
    """The clouds of sweeps in order of time, and notes for the user on what they lack."""
    loaded = [(sweep, sweep.load()) for sweep in sorted(sweeps, key=lambda sweep: sweep.time)]
    loaded = [(sweep, found) for sweep, found in loaded if len(found.points)]
    if not loaded:
        return [], []
    positions = sensor_positions(clip, np.array([sweep.time for sweep, _ in loaded]))
    near = [
        found.points[np.linalg.norm(found.points[:, :2] - position[:2], axis=1) < FARTHEST]
        for (_, found), position in zip(loaded, positions, strict=True)
    ]
    every = np.concatenate([part[thin_rows(part, GROUND_SPACING)] for part in near])
    if not len(every):
        return [], ["no sweep has a point near the cameras: do poses and sweeps belong together?"]
    ground = find_ground(every[thin_rows(every, GROUND_SPACING)])
    clouds, untimed = [], 0
    for (sweep, found), position in zip(loaded, positions, strict=True):
        times = usable_times(found, sweep.time)
        untimed += times is None
        clouds.append(_cloud(sweep, found, position, ground, times))
    notes = []
    if untimed:
        notes.append(
            f"{untimed} of {len(clouds)} sweeps have no usable time per point (column t): "
            "objects are placed as if each sweep were taken in one moment"
        )
    return clouds, notes


def usable_times(found: SweepPoints, time: float) -> Float64[ndarray, " n"] | None:
    """The times of a sweep's points; None where there are none, or they are of another clock than the sweep's."""
    if found.times is None or np.abs(found.times - time).max(initial=0) > LATEST:
        return None
    return found.times


def sensor_positions(clip: Clip, times: Float64[ndarray, " s"]) -> Float64[ndarray, "s 3"]:
    """Where the LiDAR is at some times, roughly: amid the cameras, which move evenly between photos."""
    by_time: dict[float, list[ndarray]] = {}
    for frame in clip.frames:
        by_time.setdefault(frame.view.time, []).append(frame.view.camera.position)
    known = np.array(sorted(by_time))
    count = max(len(places) for places in by_time.values())
    whole = np.array([time for time in known if len(by_time[time]) == count])
    middle = np.array([np.mean(by_time[time], axis=0) for time in whole])
    return np.stack([np.interp(times, whole, middle[:, axis]) for axis in range(3)], axis=1)


def _cloud(
    sweep: Sweep,
    found: SweepPoints,
    position: Float64[ndarray, "3"],
    ground: GroundSurface,
    times: Float64[ndarray, " n"] | None,
) -> SweepCloud:
    own = np.full(len(found.points), sweep.time) if times is None else times
    images = tuple(
        build_sweep_image(found.points[found.sensor == sensor], position) for sensor in np.unique(found.sensor)
    )
    rows = np.flatnonzero(np.linalg.norm(found.points - position.astype(np.float32), axis=1) < FARTHEST)
    above = ground.compute_heights_above(found.points[rows])
    distance = np.linalg.norm(found.points[rows] - position.astype(np.float32), axis=1)
    kept = (distance > NEAREST) & (above > FLOOR + FLOOR_PER_METRE * distance) & (above < CEILING)
    rows, above, distance = rows[kept], above[kept], distance[kept]
    parts = []
    for sensor in np.unique(found.sensor[rows]):
        of_sensor = np.flatnonzero(found.sensor[rows] == sensor)
        parts.append(of_sensor[thin_rows(found.points[rows[of_sensor]], SPACING)])
    chosen = np.concatenate([np.zeros(0, np.int64), *parts])
    rows, above, distance = rows[chosen], above[chosen], distance[chosen]
    points = found.points[rows].copy()
    heights = points[:, 2] - above
    points[:, 2] = above
    turn = _turn(found, own, position)
    return SweepCloud(
        sweep.index, sweep.time, position, points, heights, distance, found.sensor[rows], own[rows], turn, images
    )


def _turn(found: SweepPoints, times: Float64[ndarray, " n"], position: Float64[ndarray, "3"]) -> Float64[ndarray, " b"]:
    """Median time of the first LiDAR's points in each direction, that of the nearest direction where it saw none."""
    first = found.sensor == found.sensor.min()
    bearing = compute_bearings(found.points[first, :2] - position[:2])
    order = np.lexsort((times[first], bearing))
    counts = np.bincount(bearing, minlength=BEARINGS)
    middle = np.cumsum(counts) - counts + counts // 2
    known = np.flatnonzero(counts)
    turn = times[first][order[np.minimum(middle, len(order) - 1)]]
    apart = np.abs((np.arange(BEARINGS)[:, None] - known + BEARINGS // 2) % BEARINGS - BEARINGS // 2)
    return turn[known[apart.argmin(axis=1)]]
