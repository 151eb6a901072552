"""What one LiDAR saw of a thing in one sweep: points, the direction of their surface, and when."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Float64
from numpy import ndarray
from scipy.spatial import KDTree

from instdrive_core.tracks.nearest import sample_evenly, sample_rows
from instdrive_core.tracks.sweep_clouds import SweepCloud

MIN_POINTS = 3
LIMIT = 160
"""Points of an observation that poses are solved with."""
NEIGHBOURS = 9
THIN = 0.04
"""Share of the second to the largest spread of neighbours below which they lie on one scan line."""
LEVEL = 0.35
"""Length along the ground of a surface's direction below which it says nothing of motion along the ground."""


@dataclass(frozen=True, eq=False)
class Observation:
    """Points of a thing as one LiDAR met them in one sweep."""

    sweep: int
    """Position among the clouds."""
    sensor: int
    time: float
    """Mean time of the points, seconds."""
    points: Float32[ndarray, "k 3"]
    """Metres, z above the ground."""
    lags: Float32[ndarray, " k"]
    """Seconds of each point after `time`."""
    normals: Float32[ndarray, "k 3"]
    """Direction across the surface; 0 where unknown or level."""

    @property
    def middle(self) -> Float64[ndarray, "2"]:
        """Centre of the box around the points, along the ground."""
        return (self.points[:, :2].min(axis=0) + self.points[:, :2].max(axis=0)).astype(float) / 2


def observe(cloud: SweepCloud, rows: ndarray, sweep: int) -> list[Observation]:
    """The observations, one for each LiDAR, that some points of a sweep make up."""
    found = []
    for sensor in np.unique(cloud.sensor[rows]):
        own = rows[cloud.sensor[rows] == sensor]
        if len(own) < MIN_POINTS:
            continue
        time = float(cloud.times[own].mean())
        chosen = sample_rows(own, LIMIT)
        points = np.ascontiguousarray(cloud.points[chosen])
        normals = surface_normals(points, sample_evenly(cloud.points[own], 4 * LIMIT))
        lags = (cloud.times[chosen] - time).astype(np.float32)
        found.append(Observation(sweep, int(sensor), time, points, lags, normals))
    return found


def surface_normals(points: Float32[ndarray, "k 3"], around: Float32[ndarray, "n 3"]) -> Float32[ndarray, "k 3"]:
    """Direction across the surface at each point, from its neighbours; those on one scan line are taken to lie on an
    upright surface. 0 where it is unknown or level."""
    count = min(NEIGHBOURS, len(around))
    if count < 3:
        return np.zeros_like(points)
    _, near = KDTree(around).query(points, count)
    offsets = around[near].astype(float)
    offsets -= offsets.mean(axis=1, keepdims=True)
    spreads, axes = np.linalg.eigh(np.einsum("kni,knj->kij", offsets, offsets))
    normals = axes[:, :, 0]
    line = axes[:, :, 2]
    thin = spreads[:, 1] < THIN * spreads[:, 2]
    upright = np.stack([line[:, 1], -line[:, 0], np.zeros(len(line))], axis=1)
    normals = np.where(thin[:, None], upright, normals)
    normals[np.linalg.norm(normals[:, :2], axis=1) < LEVEL] = 0
    return np.ascontiguousarray(normals, np.float32)
