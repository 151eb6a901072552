"""Moved points of LiDAR: other sweeps looked through the place where they lie."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64
from numpy import ndarray
from scipy import ndimage

BIN = 0.3
"""Degrees along an edge of a range image's pixels."""
LOWEST, HIGHEST = -35.0, 25.0
"""Elevations in degrees that range images cover."""
MARGIN, MARGIN_SHARE = 0.6, 0.03
"""Metres, and share of its distance, by which a beam must go on behind a point to have gone through its place."""


@dataclass(frozen=True)
class RangeImage:
    """Distances that one sweep met in each direction."""

    position: Float64[ndarray, "3"]
    """Position of the sensor, roughly."""
    nearest: Float32[ndarray, "elevations azimuths"]
    """Distance of the nearest point in a pixel and its neighbours; infinity where there is none."""
    measured: Bool[ndarray, "elevations azimuths"]
    """Pixels that hold a point themselves."""


def build_range_image(points: Float32[ndarray, "n 3"], position: Float64[ndarray, "3"]) -> RangeImage:
    """Build the range image of a sweep taken from `position`."""
    rows, columns, distances = _compute_directions(points, position)
    shape = round((HIGHEST - LOWEST) / BIN), round(360 / BIN)
    nearest = np.full(shape, np.inf, np.float32)
    np.minimum.at(nearest, (rows, columns), distances)
    around = ndimage.minimum_filter1d(
        ndimage.minimum_filter1d(nearest, 3, axis=0, mode="nearest"), 3, axis=1, mode="wrap"
    )
    return RangeImage(position, np.asarray(around), np.isfinite(nearest))


def is_seen_through(points: Float32[ndarray, "n 3"], image: RangeImage) -> Bool[ndarray, " n"]:
    """Whether a sweep met something only behind each point, so that nothing can have been at its place then."""
    rows, columns, distances = _compute_directions(points, image.position)
    behind = image.nearest[rows, columns] > distances * (1 + MARGIN_SHARE) + MARGIN
    return behind & image.measured[rows, columns]


def _compute_directions(
    points: Float32[ndarray, "n 3"], position: Float64[ndarray, "3"]
) -> tuple[Int64[ndarray, " n"], Int64[ndarray, " n"], Float32[ndarray, " n"]]:
    """Compute row and column in a range image, and the distance, of each point."""
    offsets = points - position.astype(np.float32)
    distances = np.linalg.norm(offsets, axis=1)
    elevations = np.degrees(np.arcsin(np.clip(offsets[:, 2] / np.maximum(distances, 1e-6), -1, 1)))
    azimuths = np.degrees(np.arctan2(offsets[:, 1], offsets[:, 0])) + 180
    rows = np.clip((elevations - LOWEST) / BIN, 0, round((HIGHEST - LOWEST) / BIN) - 1)
    return rows.astype(np.int64), (azimuths / BIN).astype(np.int64) % round(360 / BIN), distances
