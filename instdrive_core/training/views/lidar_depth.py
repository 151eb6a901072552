"""LiDAR points in photos: the pixel that each falls on, and the nearest depth of each pixel."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import groupby

import numba
import numpy as np
from jaxtyping import Float32, Float64, Int32
from numpy import ndarray

from instdrive_core.datasets.clip import Clip, Frame
from instdrive_core.datasets.sweeps import SweepCache
from instdrive_core.scene.camera import Camera

NEAREST_DEPTH = 0.5
"""Metres; what is nearer belongs to the recording car."""
MAX_LIDAR_DEPTH = 80.0
"""Metres; farther returns are too sparse to supervise depth."""

Depths = tuple[Int32[ndarray, " k"], Float32[ndarray, " k"]]
"""Flat indices of pixels, rising, and their depths in metres along the optical axis."""


def load_frame_depths(clip: Clip, frames: Sequence[Frame]) -> list[Depths]:
    """Load the LiDAR depth of each frame from sweeps that may train: metres up to `MAX_LIDAR_DEPTH`, no ego car.

    Sweeps are read once each where frames are ordered by time step, while the photos' depths of the step before are
    computed in other threads.

    Raises DataError where a sweep is damaged.
    """
    sweeps = SweepCache(clip, held_out=False)
    depths: list[Depths] = []
    running: list[Future[Depths]] = []
    with ThreadPoolExecutor(numba.get_num_threads()) as pool:
        for index, of_step in groupby(frames, key=lambda frame: frame.view.index):
            points = sweeps.load_positions(index)
            depths += [future.result() for future in running]
            running = [pool.submit(compute_frame_depths, frame, points) for frame in of_step]
        depths += [future.result() for future in running]
    return depths


def compute_frame_depths(frame: Frame, points: Float32[ndarray, "n 3"]) -> Depths:
    """Compute the LiDAR depth of a frame, given the points of its time step; none on the ego car."""
    pixels, depths = project_depths(points, frame.view.camera)
    if frame.valid is None:
        return pixels, depths
    on_scene = frame.valid.ravel()[pixels]
    return pixels[on_scene], depths[on_scene]


def project_depths(points: Float32[ndarray, "n 3"], camera: Camera) -> Depths:
    """Compute the nearest LiDAR depth of each pixel that a point falls on, at most `MAX_LIDAR_DEPTH`."""
    pixels, depths = find_pixels_of_points(points, camera, MAX_LIDAR_DEPTH)
    return _nearest(pixels, depths, camera.width * camera.height)


def find_pixels_of_points(
    points: Float32[ndarray, "n 3"], camera: Camera, farthest: float = np.inf
) -> tuple[Int32[ndarray, " n"], Float32[ndarray, " n"]]:
    """Find the flat index of the pixel that each point falls on, -1 outside of the photo, and depths in metres.

    The interpreter's lock is released while it computes.
    """
    matrix = np.ascontiguousarray(camera.camera_from_world[:3])
    intrinsics = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
    points = np.ascontiguousarray(points, np.float32)
    return _pixels_of_points(points, matrix, intrinsics, camera.width, camera.height, NEAREST_DEPTH, float(farthest))


def find_nearest_per_pixel(pixels: Int32[ndarray, " n"], depths: Float32[ndarray, " n"]) -> Depths:
    """Find the smallest depth of each pixel that occurs; pixels come out sorted."""
    return _nearest(pixels.astype(np.int32), depths.astype(np.float32), int(pixels.max(initial=-1)) + 1)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _pixels_of_points(
    points: Float32[ndarray, "n 3"],
    matrix: Float64[ndarray, "3 4"],
    intrinsics: Float64[ndarray, "4"],
    width: int,
    height: int,
    nearest: float,
    farthest: float,
) -> tuple[Int32[ndarray, " n"], Float32[ndarray, " n"]]:
    fx, fy, cx, cy = intrinsics
    pixels = np.full(len(points), -1, np.int32)
    depths = np.zeros(len(points), np.float32)
    for i in range(len(points)):
        x, y, z = np.float64(points[i, 0]), np.float64(points[i, 1]), np.float64(points[i, 2])
        depth = matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * z + matrix[2, 3]
        depths[i] = depth
        if not nearest < depth < farthest:
            continue
        column = (matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] * z + matrix[0, 3]) / depth * fx + cx
        row = (matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] * z + matrix[1, 3]) / depth * fy + cy
        if 0 <= column < width and 0 <= row < height:
            pixels[i] = int(row) * width + int(column)
    return pixels, depths


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _nearest(
    pixels: Int32[ndarray, " n"], depths: Float32[ndarray, " n"], size: int
) -> tuple[Int32[ndarray, " k"], Float32[ndarray, " k"]]:
    nearest = np.full(size, np.inf, np.float32)
    for i in range(len(pixels)):
        if pixels[i] >= 0:
            nearest[pixels[i]] = min(nearest[pixels[i]], depths[i])
    count = 0
    for pixel in range(size):
        count += nearest[pixel] < np.inf
    found, values = np.empty(count, np.int32), np.empty(count, np.float32)
    position = 0
    for pixel in range(size):
        if nearest[pixel] < np.inf:
            found[position], values[position] = pixel, nearest[pixel]
            position += 1
    return found, values
