"""Intersection over union of upright boxes in space."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64
from numpy import ndarray


def compute_box_iou(
    first: Float64[ndarray, "4 4"],
    first_size: Float64[ndarray, "3"],
    second: Float64[ndarray, "4 4"],
    second_size: Float64[ndarray, "3"],
) -> float:
    """Intersection over union of two boxes, as if both stood upright: tilts of a road's slope are left out.

    Poses are world from box, the origin at the centre; sizes are along the box's own axes, metres.
    """
    ground = _measure_shared_ground(_list_corners(first, first_size), _list_corners(second, second_size))
    low = max(first[2, 3] - first_size[2] / 2, second[2, 3] - second_size[2] / 2)
    high = min(first[2, 3] + first_size[2] / 2, second[2, 3] + second_size[2] / 2)
    shared = ground * max(high - low, 0.0)
    return float(shared / (np.prod(first_size) + np.prod(second_size) - shared))


def _list_corners(pose: Float64[ndarray, "4 4"], size: Float64[ndarray, "3"]) -> Float64[ndarray, "4 2"]:
    """Corners seen from above, counter-clockwise."""
    forward = pose[:2, 1] / max(float(np.linalg.norm(pose[:2, 1])), 1e-9)
    right = np.array([forward[1], -forward[0]])
    signs = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) / 2
    return pose[:2, 3] + signs[:, :1] * size[0] * right + signs[:, 1:] * size[1] * forward


def _measure_shared_ground(polygon: Float64[ndarray, "4 2"], window: Float64[ndarray, "4 2"]) -> float:
    """Area of one convex polygon inside another (Sutherland and Hodgman 1974)."""
    points = list(polygon)
    for start, end in zip(window, np.roll(window, -1, axis=0), strict=True):
        edge, kept = end - start, []
        sides = [float(edge[0] * (point - start)[1] - edge[1] * (point - start)[0]) for point in points]
        for number, (point, side) in enumerate(zip(points, sides, strict=True)):
            before, side_before = points[number - 1], sides[number - 1]
            if (side >= 0) != (side_before >= 0):
                kept.append(before + (point - before) * side_before / (side_before - side))
            if side >= 0:
                kept.append(point)
        points = kept
        if not points:
            return 0.0
    x, y = np.array(points).T
    return float(abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2)
