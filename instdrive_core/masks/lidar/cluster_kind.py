"""Kinds of clusters of LiDAR points by size and shape: things, parts of facades, low walls, vegetation."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float32, Int32, Int64, UInt32
from numpy import ndarray
from scipy import ndimage

from instdrive_core.masks.lidar.point_shape import PointShape

NONE, GROUND, FACADE, WALL, VEGETATION, BACKDROP, THING = range(7)
"""Kinds of clusters, the wide ones before things. Walls are fences and long hedges, too, no higher than a lorry. The
backdrop is what is wide and so far off that its shape does not tell what it is."""

MIN_POINTS = 8
"""Smaller clusters are nothing."""
TALL = 3.6
"""Metres above the ground above which no vehicle reaches."""
LONG, VERY_LONG = 6.0, 16.0
"""Metres along the ground of a facade's part if it is tall, or if it is not."""
UPRIGHT = 0.5
"""Share of vertical surfaces from which on a cluster is a facade rather than a plant."""
SCATTERED = 0.4
"""Mean scatter from which on a cluster is a plant."""
FLAT = 0.4
"""Metres above the ground: what rises no higher belongs to it."""
SURFACE = 0.3
"""Mean scatter below which a cluster is a surface."""
OVERHEAD = 1.5
"""Metres above the ground of the lowest twig of a crown."""
WALL_PIECE = 2.5
"""Metres along the ground of a piece of a tall facade."""
SMALLEST_PLANT = 0.8
"""Metres along the ground."""
VEHICLE_LENGTH, VEHICLE_WIDTH, VEHICLE_TOP, VEHICLE_BASE = 5.6, 2.3, 2.6, 1.0
"""Metres that a car or van may measure, and above the ground where its lowest point may be."""
SHORTEST = 1.5
"""Metres that a vehicle's rear is wide at least."""
POST_LENGTH, TALLEST = 1.6, 4.2
"""Metres: what is higher than a van and no longer than the first, or higher than a lorry, the second, or does not stand
on the ground, is street furniture: posts, signs, lamps."""


def classify_clusters(
    points: Float32[ndarray, "n 3"],
    clusters: Int32[ndarray, " n"],
    shape: PointShape,
    above: Float32[ndarray, " n"],
) -> UInt32[ndarray, " c"]:
    """Classify each cluster as `NONE`, `GROUND`, `FACADE`, `WALL`, `VEGETATION` or `THING`; long hedges are walls.

    Args:
        points: metres.
        clusters: number from 0 by point, none left out.
        shape: around each point.
        above: metres above the ground.
    """
    if not len(points):
        return np.zeros(0, np.uint32)
    numbers = np.arange(int(clusters.max()) + 1)
    counts = np.bincount(clusters, minlength=len(numbers))
    length = _measure_length(points, clusters, counts)
    top = np.asarray(ndimage.maximum(above, clusters, numbers))
    base = np.asarray(ndimage.minimum(above, clusters, numbers))
    scatter = np.bincount(clusters, shape.scatter, len(numbers)) / counts
    upright = np.bincount(clusters, shape.upright, len(numbers)) / counts
    kinds = np.full(len(numbers), THING, np.uint32)
    large = ((length > LONG) & (top > TALL)) | (length > VERY_LONG)
    kinds[large] = np.where((upright[large] > UPRIGHT) | (scatter[large] < SURFACE), FACADE, VEGETATION)
    no_vehicle = (top > VEHICLE_TOP) | (length > VEHICLE_LENGTH) | (length < SHORTEST) | (base > VEHICLE_BASE)
    kinds[(scatter > SCATTERED) & (length > SMALLEST_PLANT) & (top > 1.0) & no_vehicle] = VEGETATION
    kinds[(scatter > SURFACE) & (base > OVERHEAD) & (length > SMALLEST_PLANT)] = VEGETATION
    kinds[(upright > UPRIGHT) & (top > TALL) & (length > WALL_PIECE) & (scatter < SCATTERED)] = FACADE
    kinds[(kinds == VEGETATION) & (top < TALL) & (length > LONG)] = WALL
    kinds[top < FLAT] = GROUND
    kinds[counts < MIN_POINTS] = NONE
    return kinds


def find_furniture(
    points: Float32[ndarray, "n 3"], clusters: Int32[ndarray, " n"], above: Float32[ndarray, " n"], count: int
) -> Bool[ndarray, " c"]:
    """Find which of `count` clusters (number by point) are too slim, high or airy for anything but posts and signs."""
    counts = np.bincount(clusters, minlength=count)
    length = _measure_length(points, clusters, counts)
    top = np.asarray(ndimage.maximum(above, clusters, np.arange(count)))
    base = np.asarray(ndimage.minimum(above, clusters, np.arange(count)))
    slender = (top > VEHICLE_TOP) & (length < POST_LENGTH)
    return (counts > 0) & ((base > VEHICLE_BASE) | (top > TALLEST) | slender)


def _measure_length(
    points: Float32[ndarray, "n 3"], clusters: Int32[ndarray, " n"], counts: Int64[ndarray, " c"]
) -> Float32[ndarray, " c"]:
    """Longest extent along the ground, over a few directions."""
    numbers = np.arange(len(counts))
    length = np.zeros(len(counts), np.float32)
    for angle in np.radians(np.arange(0, 180, 22.5)):
        along = points[:, 0] * np.cos(angle) + points[:, 1] * np.sin(angle)
        extent = np.asarray(ndimage.maximum(along, clusters, numbers)) - ndimage.minimum(along, clusters, numbers)
        length = np.maximum(length, extent.astype(np.float32))
    return length
