"""Gradient of the projection: from sums over pixels to means, quaternions, log scales, opacities and channels."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from jaxtyping import Bool, Float32
from numpy import ndarray

from instdrive_core.rasterize.kernels.backward import (
    SUM_ABS_X,
    SUM_ABS_Y,
    SUM_CHANNELS,
    SUM_D,
    SUM_DEPTH,
    SUM_X,
    SUM_XX,
    SUM_XY,
    SUM_Y,
    SUM_YY,
    PairSums,
)
from instdrive_core.rasterize.kernels.bin import TileLists
from instdrive_core.rasterize.kernels.project import (
    CONIC_XX,
    CONIC_XY,
    CONIC_YY,
    OPACITY,
    SPLAT_WIDTH,
    Projection,
    camera_to_row,
)
from instdrive_core.rasterize.kernels.simd import prefetch
from instdrive_core.scene.camera import Camera

_CHUNK = 1 << 8
"""Rows that one thread takes at a time."""
_PREFETCHED_LINES = np.uint64(4)
"""Cache lines of a splat's sums that are fetched ahead: those of three pairs; the rest follows by itself."""


@dataclass(frozen=True)
class RasterGradients:
    """Gradients of a loss with respect to the Gaussians, and what densification asks for; zero where unseen."""

    means: Float32[ndarray, "n 3"]
    quats: Float32[ndarray, "n 4"]
    log_scales: Float32[ndarray, "n 3"]
    opacities: Float32[ndarray, " n"]
    """Gradients with respect to the opacity in (0, 1), not its logit."""
    channels: Float32[ndarray, "n c"]
    means2d_abs: Float32[ndarray, " n"]
    """Length of (Σ|∂L/∂x|, Σ|∂L/∂y|) over the pixels, x and y the projected mean in pixels (AbsGS, Ye et al. 2024).
    gsplat's thresholds are for coordinates in [-1, 1]: multiply by half the image's size."""
    visible: Bool[ndarray, " n"]
    """Whether the splat reaches any pixel centre."""


def project_backward(
    means: Float32[ndarray, "n 3"],
    quats: Float32[ndarray, "n 4"],
    log_scales: Float32[ndarray, "n 3"],
    camera: Camera,
    projection: Projection,
    tiles: TileLists,
    pair_sums: PairSums,
    channels: int,
) -> RasterGradients:
    """Add each splat's pair sums in tile order and carry them back through the projection."""
    count = len(means)
    result = RasterGradients(
        means=np.empty((count, 3), np.float32),
        quats=np.empty((count, 4), np.float32),
        log_scales=np.empty((count, 3), np.float32),
        opacities=np.empty(count, np.float32),
        channels=np.empty((count, channels), np.float32),
        means2d_abs=np.empty(count, np.float32),
        visible=np.empty(count, np.bool_),
    )
    _project_backward(
        (means, quats, log_scales),
        camera_to_row(camera),
        (projection.places, projection.splats),
        (tiles.splat_starts, pair_sums.touched, pair_sums.rows),
        (pair_sums.geometry_channels, pair_sums.feature_column),
        (result.means, result.quats, result.log_scales, result.opacities, result.channels),
        (result.means2d_abs, result.visible),
    )
    return result


@numba.njit(cache=True, forceinline=True, error_model="numpy")
def _prefetch(places, splats, paired, start, stop):
    """Have fetched what the splats of these rows need: they lie in depth order, so anywhere."""
    splat_starts, _, pair_sums = paired
    pair_width = np.uint64(pair_sums.shape[1])
    for i in range(start, stop):
        v = np.uint64(max(places[i], 0))
        prefetch(splat_starts, v)
        prefetch(splats, v * np.uint64(SPLAT_WIDTH))
    for i in range(start, stop):
        if places[i] >= 0:
            entry = np.uint64(splat_starts[places[i]])
            for line in range(_PREFETCHED_LINES):
                prefetch(pair_sums, entry * pair_width + line * np.uint64(16))


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=True)
def _sum_pairs(paired, v, sums):
    """Add the rows of splat v; False where it reaches no pixel."""
    splat_starts, touched, pair_sums = paired
    sums[:] = 0
    for entry in range(splat_starts[v], splat_starts[v + 1]):
        if touched[entry]:
            pair = np.uint64(entry)
            for k in range(np.uint64(len(sums))):
                sums[k] += pair_sums[pair, k]
    return splat_starts[v] < splat_starts[v + 1]


@numba.njit(cache=True, forceinline=True, error_model="numpy")
def _write_zeros(i, grads, statistics):
    grad_means, grad_quats, grad_log_scales, grad_opacities, grad_channels = grads
    grad_means[i], grad_quats[i], grad_log_scales[i], grad_channels[i] = 0, 0, 0, 0
    grad_opacities[i] = statistics[0][i] = 0


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=True)
def _covariance_gradient(conic_xx, conic_xy, conic_yy, sums):
    """dL/dΣ = -conic · dL/dconic · conic, as the entries xx, xy (one of the two) and yy."""
    half = np.float32(0.5)
    xx, xy, yy = -half * sums[SUM_XX], -half * sums[SUM_XY], -half * sums[SUM_YY]
    p00, p01 = conic_xx * xx + conic_xy * xy, conic_xx * xy + conic_xy * yy
    p10, p11 = conic_xy * xx + conic_yy * xy, conic_xy * xy + conic_yy * yy
    return (
        -(p00 * conic_xx + p01 * conic_xy),
        -(p00 * conic_xy + p01 * conic_yy),
        -(p10 * conic_xy + p11 * conic_yy),
    )


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=True)
def _rotation(w, x, y, z):
    """Rotation matrix of a unit quaternion, row by row."""
    one, two = np.float32(1), np.float32(2)
    return (
        one - two * (y * y + z * z),
        two * (x * y - w * z),
        two * (x * z + w * y),
        two * (x * y + w * z),
        one - two * (x * x + z * z),
        two * (y * z - w * x),
        two * (x * z - w * y),
        two * (y * z + w * x),
        one - two * (x * x + y * y),
    )


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=True)
def _quaternion_gradient(w, x, y, z, g, length):
    """Gradient with respect to a quaternion of any length, from that of its rotation matrix (nine entries)."""
    two = np.float32(2)
    dw = two * (x * (g[7] - g[5]) + y * (g[2] - g[6]) + z * (g[3] - g[1]))
    dx = two * (y * (g[1] + g[3]) + z * (g[2] + g[6]) + w * (g[7] - g[5]) - two * x * (g[4] + g[8]))
    dy = two * (x * (g[1] + g[3]) + z * (g[5] + g[7]) + w * (g[2] - g[6]) - two * y * (g[0] + g[8]))
    dz = two * (x * (g[2] + g[6]) + y * (g[5] + g[7]) + w * (g[3] - g[1]) - two * z * (g[0] + g[4]))
    along = dw * w + dx * x + dy * y + dz * z
    return (dw - along * w) / length, (dx - along * x) / length, (dy - along * y) / length, (dz - along * z) / length


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=True)
def _write_gradients(i, splat, sums, inputs, view, layout, grads):
    """Carry the sums of one splat back to its parameters."""
    means, quats, log_scales = inputs
    grad_means, grad_quats, grad_log_scales, grad_opacities, grad_channels = grads
    fx, fy = view[12], view[13]
    one, two, zero = np.float32(1), np.float32(2), np.float32(0)
    geometry, feature_column = layout
    for channel in range(geometry):
        grad_channels[i, channel] = sums[SUM_CHANNELS + channel]
    for channel in range(geometry, grad_channels.shape[1]):
        grad_channels[i, channel] = sums[feature_column + channel - geometry]
    grad_opacities[i] = sums[SUM_D] / splat[OPACITY]

    conic_xx, conic_xy, conic_yy = splat[CONIC_XX], splat[CONIC_XY], splat[CONIC_YY]
    d_px = conic_xx * sums[SUM_X] + conic_xy * sums[SUM_Y]
    d_py = conic_xy * sums[SUM_X] + conic_yy * sums[SUM_Y]
    d_xx, d_xy, d_yy = _covariance_gradient(conic_xx, conic_xy, conic_yy, sums)

    # the forward pass again: camera point, T = J·R_view, Q = T·R, U = Q·S
    mx, my, mz = means[i, 0], means[i, 1], means[i, 2]
    x = view[0] * mx + view[1] * my + view[2] * mz + view[9]
    y = view[3] * mx + view[4] * my + view[5] * mz + view[10]
    rz = one / (view[6] * mx + view[7] * my + view[8] * mz + view[11])
    slope_x, slope_y = x * rz, y * rz
    tx, ty = min(max(slope_x, view[18]), view[19]), min(max(slope_y, view[20]), view[21])
    j00, j02, j11, j12 = fx * rz, -fx * tx * rz, fy * rz, -fy * ty * rz
    t00, t01, t02 = j00 * view[0] + j02 * view[6], j00 * view[1] + j02 * view[7], j00 * view[2] + j02 * view[8]
    t10, t11, t12 = j11 * view[3] + j12 * view[6], j11 * view[4] + j12 * view[7], j11 * view[5] + j12 * view[8]
    qw, qx, qy, qz = quats[i, 0], quats[i, 1], quats[i, 2], quats[i, 3]
    length = np.sqrt(qw * qw + qx * qx + qy * qy + qz * qz)
    qw, qx, qy, qz = qw / length, qx / length, qy / length, qz / length
    r = _rotation(qw, qx, qy, qz)

    # Σ = U·Uᵀ, so dL/dU = 2·dL/dΣ·U, column by column of the splat's axes
    e00 = e01 = e02 = e10 = e11 = e12 = zero  # dL/dT
    g0 = g1 = g2 = g3 = g4 = g5 = g6 = g7 = g8 = zero  # dL/dR
    for axis in range(3):
        ra, rb, rc = r[axis], r[3 + axis], r[6 + axis]
        size = np.exp(log_scales[i, axis])
        u0, u1 = size * (t00 * ra + t01 * rb + t02 * rc), size * (t10 * ra + t11 * rb + t12 * rc)
        d_u0, d_u1 = two * (d_xx * u0 + d_xy * u1), two * (d_xy * u0 + d_yy * u1)
        grad_log_scales[i, axis] = d_u0 * u0 + d_u1 * u1
        d_q0, d_q1 = d_u0 * size, d_u1 * size
        e00, e01, e02 = e00 + d_q0 * ra, e01 + d_q0 * rb, e02 + d_q0 * rc
        e10, e11, e12 = e10 + d_q1 * ra, e11 + d_q1 * rb, e12 + d_q1 * rc
        ga, gb, gc = t00 * d_q0 + t10 * d_q1, t01 * d_q0 + t11 * d_q1, t02 * d_q0 + t12 * d_q1
        if axis == 0:
            g0, g3, g6 = ga, gb, gc
        elif axis == 1:
            g1, g4, g7 = ga, gb, gc
        else:
            g2, g5, g8 = ga, gb, gc
    gradient = _quaternion_gradient(qw, qx, qy, qz, (g0, g1, g2, g3, g4, g5, g6, g7, g8), length)
    grad_quats[i, 0], grad_quats[i, 1], grad_quats[i, 2], grad_quats[i, 3] = gradient

    d_j00, d_j02 = e00 * view[0] + e01 * view[1] + e02 * view[2], e00 * view[6] + e01 * view[7] + e02 * view[8]
    d_j11, d_j12 = e10 * view[3] + e11 * view[4] + e12 * view[5], e10 * view[6] + e11 * view[7] + e12 * view[8]
    d_z = (fx * (tx * d_j02 - d_j00) + fy * (ty * d_j12 - d_j11)) * rz * rz + sums[SUM_DEPTH]
    d_slope_x, d_slope_y = d_px * fx, d_py * fy
    if tx == slope_x:
        d_slope_x -= fx * rz * d_j02
    if ty == slope_y:
        d_slope_y -= fy * rz * d_j12
    d_x, d_y = d_slope_x * rz, d_slope_y * rz
    d_z -= d_x * slope_x + d_y * slope_y
    for axis in range(3):
        grad_means[i, axis] = view[axis] * d_x + view[3 + axis] * d_y + view[6 + axis] * d_z


@numba.njit(cache=True, parallel=True, error_model="numpy", fastmath=True)
def _project_backward(inputs, view, projected, paired, layout, grads, statistics):
    places, splats = projected
    visible, count = statistics[1], len(projected[0])
    for chunk in numba.prange((count + _CHUNK - 1) // _CHUNK):
        start, stop = chunk * _CHUNK, min((chunk + 1) * _CHUNK, count)
        sums = np.empty((_CHUNK, paired[2].shape[1]), np.float32)
        _prefetch(places, splats, paired, start, stop)
        for i in range(start, stop):  # alone, so that the cache misses of many splats overlap
            visible[i] = places[i] >= 0 and _sum_pairs(paired, places[i], sums[i - start])
        for i in range(start, stop):
            if visible[i]:
                statistics[0][i] = np.sqrt(sums[i - start, SUM_ABS_X] ** 2 + sums[i - start, SUM_ABS_Y] ** 2)
                _write_gradients(i, splats[places[i]], sums[i - start], inputs, view, layout, grads)
            else:
                _write_zeros(i, grads, statistics)
