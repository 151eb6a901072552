"""Points drawn as squares with a depth test: the nearest labelled surface in each pixel."""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float32, Float64, UInt32
from numpy import ndarray

from instdrive_core.scene.camera import Camera

NEAR = 0.3
MAX_HALF_SIZE = 12.0
"""Pixels; bounds the work for points right in front of the camera."""


def draw_points(
    points: Float32[ndarray, "n 3"], ids: UInt32[ndarray, " n"], camera: Camera, size: float
) -> tuple[UInt32[ndarray, "h w"], Float32[ndarray, "h w"]]:
    """Draw ID and depth (metres along the optical axis) of the nearest point in each pixel; 0 and infinity where none
    is.

    Args:
        points: in the world.
        ids: by point.
        camera: the view.
        size: edge of the square that a point stands for, in metres; it covers its own pixel at least.
    """
    labels = np.zeros((camera.height, camera.width), np.uint32)
    depths = np.full((camera.height, camera.width), np.inf, np.float32)
    _splat(points, ids, camera.camera_from_world, camera.intrinsics, size, labels, depths)
    return labels, depths


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _splat(
    points: Float32[ndarray, "n 3"],
    ids: UInt32[ndarray, " n"],
    camera_from_world: Float64[ndarray, "4 4"],
    intrinsics: Float64[ndarray, "3 3"],
    size: float,
    labels: UInt32[ndarray, "h w"],
    depths: Float32[ndarray, "h w"],
) -> None:
    height, width = labels.shape
    m = camera_from_world
    fx, fy, cx, cy = intrinsics[0, 0], intrinsics[1, 1], intrinsics[0, 2], intrinsics[1, 2]
    for p in range(len(points)):
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        depth = m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3]
        if depth < NEAR:
            continue
        u = fx * (m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3]) / depth + cx
        v = fy * (m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3]) / depth + cy
        half = min(max(0.5 * size * fx / depth, 0.5), MAX_HALF_SIZE)
        if u + half < 0 or v + half < 0 or u - half >= width or v - half >= height:
            continue
        left, right = max(0, int(np.ceil(u - half - 0.5))), min(width - 1, int(np.floor(u + half - 0.5)))
        top, bottom = max(0, int(np.ceil(v - half - 0.5))), min(height - 1, int(np.floor(v + half - 0.5)))
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                if depth < depths[row, column]:
                    depths[row, column] = depth
                    labels[row, column] = ids[p]
