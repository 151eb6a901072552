"""Cheap test of which Gaussians a camera may see, ahead of the rasterizer's own: the others are never touched."""

from __future__ import annotations

import math
from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int64, UInt16
from numpy import ndarray

from instdrive_core.rasterize.kernels.layout import to_kernel_array
from instdrive_core.rasterize.kernels.project import FLAGS, camera_to_row
from instdrive_core.rasterize.kernels.settings import DEFAULT_SETTINGS, RasterSettings
from instdrive_core.scene.camera import Camera

_CHUNK = 1 << 12
"""Rows that one task tests."""
ROUNDING = 4e-6
"""Largest error of a float32 camera coordinate, as a share of the lengths it was computed from."""
_LOGIT_MARGIN = 1e-3
"""Opacities near the limit may round to either side of it."""
_REACH_MARGIN = 1.002
"""Rounding of a splat's variance on the screen."""

LENGTH = 12
"""A node's row: camera_from_node (3 × 4), then the length that its rounding errors grow with."""


def find_rows_in_view(
    means: Float[ndarray, "n 3"],
    log_scales: Float[ndarray, "n 3"],
    opacity_logits: Float[ndarray, " n"],
    nodes: UInt16[ndarray, " n"],
    poses: Float64[ndarray, "m 4 4"],
    present: Bool[ndarray, " m"],
    camera: Camera,
    settings: RasterSettings = DEFAULT_SETTINGS,
) -> Int64[ndarray, " v"]:
    """Find the rows, rising, of all Gaussians that `kernels.project` would keep, and of few that it would not.

    A Gaussian is taken for a ball of its largest standard deviation, so that quaternions need not be read. What is
    kept does not depend on the number of threads.

    Args:
        means: in the frame of each row's node.
        poses: world_from_node, rigid; node 0 is the world.
        present: which nodes exist; the others' rows are left out.
    """
    count = len(means)
    kept, counts = np.empty(count, np.uint8), np.zeros(-(-count // _CHUNK) + 1, np.int64)
    found = np.empty(count, np.int32)
    arrays = (to_kernel_array(means), to_kernel_array(log_scales), to_kernel_array(opacity_logits))
    places = (np.require(nodes, np.uint16, ["C", "W"]), np.require(present, np.bool_, ["C", "W"]))
    frames, limits = list_camera_from_nodes(poses, camera), compute_view_limits(camera, settings)
    _test(*arrays, *places, frames, camera_to_row(camera), limits, kept, found, counts)
    starts = np.cumsum(counts)
    rows = np.empty(starts[-1], np.int64)
    _collect(found, starts, rows)
    return rows


def list_camera_from_nodes(poses: Float64[ndarray, "m 4 4"], camera: Camera) -> Float32[ndarray, "m 13"]:
    """List camera_from_node (3 × 4) of every node, then the length in metres that its rounding errors grow with."""
    frames = np.empty((len(poses), LENGTH + 1), np.float32)
    frames[:, :LENGTH] = (camera.camera_from_world @ poses)[:, :3].reshape(-1, LENGTH)
    # The rasterizer goes through the world: its errors grow with the positions there, however near the two may be.
    frames[:, LENGTH] = np.abs(poses[:, :3, 3]).sum(axis=1) + np.abs(camera.position).sum()
    return frames


def compute_view_limits(camera: Camera, settings: RasterSettings) -> Float32[ndarray, "6"]:
    """Compute near plane; low-pass; least logit; log of min_alpha; (1 + tan²) f² at the widest, in x and in y.

    The last two times a variance in metres², over z², are the largest variance on the screen (pixel²): the Jacobian's
    tangents are clamped there.
    """
    left, right, top, bottom = (float(value) for value in camera_to_row(camera)[18:22])
    wide_x = _REACH_MARGIN * camera.fx**2 * (1 + max(left**2, right**2))
    wide_y = _REACH_MARGIN * camera.fy**2 * (1 + max(top**2, bottom**2))
    least = math.log(settings.min_alpha / (1 - settings.min_alpha)) - _LOGIT_MARGIN
    low_pass = _REACH_MARGIN * settings.low_pass
    return np.array([settings.near, low_pass, least, math.log(settings.min_alpha), wide_x, wide_y], np.float32)


@numba.njit(cache=True, parallel=True, error_model="numpy", fastmath=FLAGS)
@no_type_check
def _test(means, log_scales, logits, nodes, present, frames, view, limits, kept, found, counts):
    """Marks the rows of each chunk, and lists them at its beginning in `found`."""
    for chunk in numba.prange(len(counts) - 1):
        start, end = chunk * _CHUNK, min(len(means), (chunk + 1) * _CHUNK)
        first = start
        while first < end:
            node, after = nodes[first], first + 1
            while after < end and nodes[after] == node:
                after += 1
            if present[node]:
                bounds = np.uint64(first), np.uint64(after)
                _test_run(means, log_scales, logits, bounds, frames[node], view, limits, kept)
            else:
                kept[first:after] = 0
            first = after
        place = start
        for i in range(start, end):
            found[place] = i
            place += kept[i]
        counts[chunk + 1] = place - start


@numba.njit(cache=True, error_model="numpy", fastmath=FLAGS)
@no_type_check
def _test_run(means, log_scales, logits, bounds, frame, view, limits, kept):
    """Rows of one node, without branches: which way they would go is hard to foretell."""
    zero, half, two, rounding = np.float32(0), np.float32(0.5), np.float32(2), np.float32(ROUNDING)
    fx, fy, cx, cy, width, height = view[12], view[13], view[14], view[15], view[16], view[17]
    near, low_pass, least, log_min_alpha = limits[0], limits[1], limits[2], limits[3]
    wide_x, wide_y = limits[4], limits[5]
    left, right, top, bottom = half - cx, cx - width + half, half - cy, cy - height + half
    pixels_x, pixels_y = fx + abs(cx) + width, fy + abs(cy) + height
    for i in range(bounds[0], bounds[1]):
        mx, my, mz, logit = means[i, 0], means[i, 1], means[i, 2], logits[i]
        slack = rounding * (abs(mx) + abs(my) + abs(mz) + frame[LENGTH])
        x = fx * (frame[0] * mx + frame[1] * my + frame[2] * mz + frame[3])
        y = fy * (frame[4] * mx + frame[5] * my + frame[6] * mz + frame[7])
        z = frame[8] * mx + frame[9] * my + frame[10] * mz + frame[11]
        # Distances beyond the borders, in pixels times z; the image ends half a pixel inside.
        beyond_x = max(max(left * z - x, right * z + x) - slack * pixels_x, zero)
        beyond_y = max(max(top * z - y, bottom * z + y) - slack * pixels_y, zero)
        size = np.exp(max(max(log_scales[i, 0], log_scales[i, 1]), log_scales[i, 2]))
        power = two * (min(logit, zero) - log_min_alpha)  # log sigmoid(l) < min(l, 0)
        blur = low_pass * z * z
        seen = (z > near - slack) & (logit >= least)
        seen &= beyond_x * beyond_x <= power * (size * size * wide_x + blur)
        seen &= beyond_y * beyond_y <= power * (size * size * wide_y + blur)
        kept[i] = seen


@numba.njit(cache=True, parallel=True)
@no_type_check
def _collect(found, starts, rows):
    for chunk in numba.prange(len(starts) - 1):
        for k in range(starts[chunk + 1] - starts[chunk]):
            rows[starts[chunk] + k] = found[chunk * _CHUNK + k]
