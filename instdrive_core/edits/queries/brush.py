"""Painting over points of a picture: which of them lie under a stroke of a round brush, and not too deep."""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Bool, Float32, Float64
from numpy import ndarray

from instdrive_core.scene.camera import Camera


def project_for_brush(points: Float32[ndarray, "n 3"], camera: Camera, near: float) -> Float32[ndarray, "n 3"]:
    """Project world points: x, y (pixels) and depth (metres) of each; NaN where nearer than `near` or not finite."""
    projected = np.empty((len(points), 3), np.float32)
    lens = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
    _project_all(points, camera.camera_from_world, lens, near, projected)
    return projected


@numba.njit(cache=True, nogil=True, error_model="numpy")
def mark_stroke(
    projected: Float32[ndarray, "n 3"],
    start: tuple[float, float],
    end: tuple[float, float],
    radius: float,
    deepest: float,
    marks: Bool[ndarray, " n"],
) -> None:
    """Set `marks` of what lies within `radius` pixels of the line from `start` to `end`, no deeper than `deepest`."""
    x0, y0 = np.float32(start[0]), np.float32(start[1])
    dx, dy = np.float32(end[0]) - x0, np.float32(end[1]) - y0
    length = dx * dx + dy * dy
    scale = np.float32(1.0) / length if length > 0 else np.float32(0.0)
    reach, limit = np.float32(radius * radius), np.float32(deepest)
    for i in range(len(projected)):
        x, y = projected[i, 0] - x0, projected[i, 1] - y0
        along = min(max((x * dx + y * dy) * scale, np.float32(0.0)), np.float32(1.0))
        off_x, off_y = x - along * dx, y - along * dy
        if off_x * off_x + off_y * off_y <= reach and projected[i, 2] <= limit:
            marks[i] = True


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _project_all(
    points: Float32[ndarray, "n 3"],
    pose: Float64[ndarray, "4 4"],
    lens: Float64[ndarray, "4"],
    near: float,
    projected: Float32[ndarray, "n 3"],
) -> None:
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        depth = pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z + pose[2, 3]
        if depth >= near:
            right = pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z + pose[0, 3]
            down = pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z + pose[1, 3]
            projected[i, 0], projected[i, 1] = right / depth * lens[0] + lens[2], down / depth * lens[1] + lens[3]
            projected[i, 2] = depth
        else:
            projected[i, :] = np.nan
