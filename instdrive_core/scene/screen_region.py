"""Regions of a picture, as the user outlines them, and the points that are seen in them."""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Bool, Float, Float32, Float64
from numpy import ndarray

from instdrive_core.scene.camera import Camera


def rasterize_polygon(corners: Float[ndarray, "v 2"], width: int, height: int) -> Bool[ndarray, "h w"]:
    """Rasterize a closed polygon: True where a pixel's centre lies inside. Corners in pixels; it may cross itself.

    What the outline runs around more than once is inside too (non-zero winding): a lasso has no holes.
    """
    ends = np.roll(corners, -1, axis=0)
    falls = ends[:, 1] < corners[:, 1]
    upper = np.where(falls[:, None], ends, corners).astype(np.float64)
    lower = np.where(falls[:, None], corners, ends).astype(np.float64)
    first, last = (np.ceil(side[:, 1] - 0.5).clip(0, height).astype(np.int64) for side in (upper, lower))
    counts = last - first
    edges = np.repeat(np.arange(len(corners)), counts)
    rows = np.arange(counts.sum()) + np.repeat(first - (np.cumsum(counts) - counts), counts)
    rise = np.where(counts > 0, lower[:, 1] - upper[:, 1], 1.0)
    slopes = (lower[:, 0] - upper[:, 0]) / rise
    crossings = upper[edges, 0] + (rows + 0.5 - upper[edges, 1]) * slopes[edges]
    columns = np.ceil(crossings - 0.5).clip(0, width).astype(np.int64)
    turns = np.zeros((height, width + 1), np.int32)
    np.add.at(turns, (rows, columns), np.where(falls[edges], -1, 1))
    return np.cumsum(turns[:, :width], axis=1) != 0


def find_points_in_region(
    points: Float32[ndarray, "n 3"], camera: Camera, region: Bool[ndarray, "h w"], near: float
) -> Bool[ndarray, " n"]:
    """Find the world points that are projected into a region, from at least `near` metres before the camera.

    `region` has the camera's size. Not finite points are in no region.
    """
    if region.shape != (camera.height, camera.width):
        raise ValueError(f"the region has shape {region.shape}, the picture {(camera.height, camera.width)}")
    inside = np.empty(len(points), np.bool_)
    lens = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
    _project(points, camera.camera_from_world, lens, near, np.ascontiguousarray(region), inside)
    return inside


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _project(
    points: Float32[ndarray, "n 3"],
    pose: Float64[ndarray, "4 4"],
    lens: Float64[ndarray, "4"],
    near: float,
    region: Bool[ndarray, "h w"],
    inside: Bool[ndarray, " n"],
) -> None:
    height, width = region.shape
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        depth = pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z + pose[2, 3]
        inside[i] = False
        if depth >= near:
            u = (pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z + pose[0, 3]) / depth * lens[0] + lens[2]
            v = (pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z + pose[1, 3]) / depth * lens[1] + lens[3]
            if 0 <= u < width and 0 <= v < height:
                inside[i] = region[int(v), int(u)]
