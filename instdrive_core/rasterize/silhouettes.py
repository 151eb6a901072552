"""Silhouettes of groups of splats, each as if nothing stood in front of it: how much of a thing a camera would see."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from jaxtyping import Int32, Int64
from numpy import ndarray

from instdrive_core.rasterize.kernels.layout import to_kernel_array
from instdrive_core.rasterize.kernels.project import project
from instdrive_core.rasterize.kernels.settings import RasterSettings, choose_raster_settings
from instdrive_core.scene.camera import Camera
from instdrive_core.scene.scene import Scene, place_in_world

_HALF = np.float32(0.5)


@dataclass(frozen=True)
class Silhouettes:
    """Silhouettes by group: row k of each array belongs to group k. Pixels outside the picture do not count."""

    pixels: Int64[ndarray, " g"]
    """Pixels that the group's splats hide at least half, with nothing in front."""
    boxes: Int64[ndarray, "g 4"]
    """First column, first row, last column + 1, last row + 1 of those pixels; zeros where there are none."""


def measure_silhouettes(
    scene: Scene, groups: Int32[ndarray, " n"], count: int, camera: Camera, time: float
) -> Silhouettes:
    """Measure the silhouettes of groups of splats as they are at `time` (seconds).

    Args:
        groups: group of each splat, 0 … count - 1; -1 belongs to none.
        count: how many groups there are.
    """
    pixels, boxes = np.zeros(count, np.int64), np.zeros((count, 4), np.int64)
    chosen = np.flatnonzero(groups >= 0)
    poses, present = scene.find_node_poses(time, camera.lag)
    nodes = scene.nodes[chosen]
    chosen = chosen[present[nodes] != 0]
    nodes, gaussians = scene.nodes[chosen], scene.gaussians
    means, quats = place_in_world(gaussians.means[chosen], gaussians.quats[chosen], nodes, poses)
    settings = choose_raster_settings(scene)
    means, quats, scales, opacities = (
        to_kernel_array(array) for array in (means, quats, gaussians.log_scales[chosen], gaussians.opacities[chosen])
    )
    found = project(means, quats, scales, opacities, camera, settings)
    owners = groups[chosen[found.rows]]
    order = np.argsort(owners, kind="stable")
    starts = np.searchsorted(owners[order], np.arange(count + 1))
    _measure(
        found.splats, found.covariances, order, starts, (camera.width, camera.height), _limits(settings), pixels, boxes
    )
    return Silhouettes(pixels, boxes)


def _limits(settings: RasterSettings) -> tuple[np.float32, np.float32]:
    return np.float32(settings.min_alpha), np.float32(settings.max_alpha)


@numba.njit(cache=True, error_model="numpy")
def _find_reach(splats, covariances, v, size):
    """Columns and rows, end exclusive, that a splat may reach."""
    limit = max(splats[v, 7], np.float32(0))
    across, down = np.sqrt(limit * covariances[v, 0]), np.sqrt(limit * covariances[v, 2])
    left = max(int(np.floor(splats[v, 0] - across - _HALF)), 0)
    right = min(int(np.ceil(splats[v, 0] + across + _HALF)), size[0])
    top = max(int(np.floor(splats[v, 1] - down - _HALF)), 0)
    bottom = min(int(np.ceil(splats[v, 1] + down + _HALF)), size[1])
    return left, top, right, bottom


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def _measure(splats, covariances, order, starts, size, limits, pixels, boxes):
    for group in numba.prange(len(pixels)):
        left, top, right, bottom = size[0], size[1], 0, 0
        for place in range(starts[group], starts[group + 1]):
            reach = _find_reach(splats, covariances, order[place], size)
            if reach[0] < reach[2] and reach[1] < reach[3]:
                left, top = min(left, reach[0]), min(top, reach[1])
                right, bottom = max(right, reach[2]), max(bottom, reach[3])
        if left >= right or top >= bottom:
            continue
        clear = np.ones((bottom - top, right - left), np.float32)
        for place in range(starts[group], starts[group + 1]):
            v = order[place]
            reach = _find_reach(splats, covariances, v, size)
            for y in range(reach[1], reach[3]):
                dy = np.float32(y) + _HALF - splats[v, 1]
                for x in range(reach[0], reach[2]):
                    dx = np.float32(x) + _HALF - splats[v, 0]
                    power = _HALF * (splats[v, 2] * dx * dx + splats[v, 4] * dy * dy) + splats[v, 3] * dx * dy
                    alpha = min(splats[v, 5] * np.exp(-power), limits[1])
                    if alpha >= limits[0]:
                        clear[y - top, x - left] *= np.float32(1) - alpha
        counted, box = 0, (size[0], size[1], -1, -1)
        for y in range(bottom - top):
            for x in range(right - left):
                if clear[y, x] <= _HALF:
                    counted += 1
                    box = (
                        min(box[0], x + left),
                        min(box[1], y + top),
                        max(box[2], x + left),
                        max(box[3], y + top),
                    )
        if counted:
            pixels[group] = counted
            boxes[group, 0], boxes[group, 1] = box[0], box[1]
            boxes[group, 2], boxes[group, 3] = box[2] + 1, box[3] + 1
