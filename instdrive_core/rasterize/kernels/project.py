"""Projection of 3D Gaussians to 2D ones: EWA splatting (Zwicker et al. 2002) as in 3DGS (Kerbl et al. 2023)."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from jaxtyping import Bool, Float32, Int32
from numpy import ndarray

from instdrive_core.maths.sorting import sort_front_to_back
from instdrive_core.rasterize.kernels.settings import RasterSettings
from instdrive_core.scene.camera import Camera

# Columns of a projected splat.
MEAN_X, MEAN_Y, CONIC_XX, CONIC_XY, CONIC_YY, OPACITY, DEPTH, POWER_LIMIT = range(8)
SPLAT_WIDTH = 8

FLAGS = {"nsz", "arcp", "contract", "afn"}
"""fastmath flags of the projection: without nnan and ninf, so that non-finite splats can be found and culled."""


@dataclass(frozen=True)
class Projection:
    """The V visible splats, nearest first (equal depths in row order)."""

    rows: Int32[ndarray, " v"]
    """Row of each visible splat in the arrays given."""
    splats: Float32[ndarray, "v 8"]
    """mean x, y (pixels); conic xx, xy, yy (1/pixel²); opacity as drawn; depth z (metres); the largest
    ½ dᵀ·conic·d at which the splat still reaches the alpha limit, times two."""
    covariances: Float32[ndarray, "v 3"]
    """2D covariance xx, xy, yy (pixel²), low-pass included."""
    places: Int32[ndarray, " n"]
    """Place of each row in `rows`, -1 for those culled."""

    def select(self, kept: Bool[ndarray, " v"]) -> Projection:
        """Leave out visible splats, as if they were culled."""
        rows, places = self.rows[kept], np.full_like(self.places, -1)
        places[rows] = np.arange(len(rows), dtype=np.int32)
        return Projection(rows, self.splats[kept], self.covariances[kept], places)


def camera_to_row(camera: Camera) -> Float32[ndarray, " 22"]:
    """Write a camera as one flat array.

    Rotation (9), translation (3), fx, fy, cx, cy, width, height, limits of the Jacobian (4).
    """
    matrix = camera.camera_from_world
    margin_x, margin_y = 0.15 * camera.width / camera.fx, 0.15 * camera.height / camera.fy
    limits = (
        -camera.cx / camera.fx - margin_x,
        (camera.width - camera.cx) / camera.fx + margin_x,
        -camera.cy / camera.fy - margin_y,
        (camera.height - camera.cy) / camera.fy + margin_y,
    )
    pinhole = (camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height)
    return np.array([*matrix[:3, :3].ravel(), *matrix[:3, 3], *pinhole, *limits], np.float32)


def project(
    means: Float32[ndarray, "n 3"],
    quats: Float32[ndarray, "n 4"],
    log_scales: Float32[ndarray, "n 3"],
    opacities: Float32[ndarray, " n"],
    camera: Camera,
    settings: RasterSettings,
) -> Projection:
    """Project, cull and sort. Culled: nearer than the near plane, fainter than min_alpha, off the image, non-finite."""
    count = len(means)
    splats, covariances = np.empty((count, SPLAT_WIDTH), np.float32), np.empty((count, 3), np.float32)
    depths = np.empty(count, np.float32)
    project_rows(means, quats, log_scales, opacities, camera, settings, splats, covariances, depths)
    rows = sort_front_to_back(depths)
    sorted_splats, sorted_covariances = (
        np.empty((len(rows), SPLAT_WIDTH), np.float32),
        np.empty((len(rows), 3), np.float32),
    )
    places = np.full(count, -1, np.int32)
    _gather(rows, splats, covariances, sorted_splats, sorted_covariances, places)
    return Projection(rows, sorted_splats, sorted_covariances, places)


def project_rows(
    means: Float32[ndarray, "n 3"],
    quats: Float32[ndarray, "n 4"],
    log_scales: Float32[ndarray, "n 3"],
    opacities: Float32[ndarray, " n"],
    camera: Camera,
    settings: RasterSettings,
    splats: Float32[ndarray, "n 8"],
    covariances: Float32[ndarray, "n 3"],
    depths: Float32[ndarray, " n"],
) -> None:
    """Write what a `Projection` holds, row by row; depth 0 for those culled, whose other numbers stay as they are."""
    _project(means, quats, log_scales, opacities, camera_to_row(camera), settings.to_row(), splats, covariances, depths)


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy", fastmath=FLAGS)
def _project(means, quats, log_scales, opacities, view, constants, splats, covariances, depths):
    near, low_pass, min_alpha, antialiased = constants[0], constants[1], constants[2], constants[5] > 0
    fx, fy, cx, cy, width, height = view[12], view[13], view[14], view[15], view[16], view[17]
    one, two, half = np.float32(1), np.float32(2), np.float32(0.5)
    for i in numba.prange(len(means)):
        depths[i] = np.float32(0)
        mx, my, mz = means[i, 0], means[i, 1], means[i, 2]
        z = view[6] * mx + view[7] * my + view[8] * mz + view[11]
        opacity = opacities[i]
        if not (z > near and opacity >= min_alpha):
            continue
        x = view[0] * mx + view[1] * my + view[2] * mz + view[9]
        y = view[3] * mx + view[4] * my + view[5] * mz + view[10]
        rz = one / z
        px, py = fx * x * rz + cx, fy * y * rz + cy

        # J · R_view: the 2 × 3 map from world offsets to pixel offsets
        tx, ty = min(max(x * rz, view[18]), view[19]), min(max(y * rz, view[20]), view[21])
        j00, j02, j11, j12 = fx * rz, -fx * tx * rz, fy * rz, -fy * ty * rz
        t00, t01, t02 = j00 * view[0] + j02 * view[6], j00 * view[1] + j02 * view[7], j00 * view[2] + j02 * view[8]
        t10, t11, t12 = j11 * view[3] + j12 * view[6], j11 * view[4] + j12 * view[7], j11 * view[5] + j12 * view[8]

        # times rotation and scale: the covariance is U·Uᵀ
        qw, qx, qy, qz = quats[i, 0], quats[i, 1], quats[i, 2], quats[i, 3]
        rq = one / np.sqrt(qw * qw + qx * qx + qy * qy + qz * qz)
        qw, qx, qy, qz = qw * rq, qx * rq, qy * rq, qz * rq
        sx, sy, sz = np.exp(log_scales[i, 0]), np.exp(log_scales[i, 1]), np.exp(log_scales[i, 2])
        r00, r01, r02 = one - two * (qy * qy + qz * qz), two * (qx * qy - qw * qz), two * (qx * qz + qw * qy)
        r10, r11, r12 = two * (qx * qy + qw * qz), one - two * (qx * qx + qz * qz), two * (qy * qz - qw * qx)
        r20, r21, r22 = two * (qx * qz - qw * qy), two * (qy * qz + qw * qx), one - two * (qx * qx + qy * qy)
        u00, u10 = sx * (t00 * r00 + t01 * r10 + t02 * r20), sx * (t10 * r00 + t11 * r10 + t12 * r20)
        u01, u11 = sy * (t00 * r01 + t01 * r11 + t02 * r21), sy * (t10 * r01 + t11 * r11 + t12 * r21)
        u02, u12 = sz * (t00 * r02 + t01 * r12 + t02 * r22), sz * (t10 * r02 + t11 * r12 + t12 * r22)
        xx, yy = u00 * u00 + u01 * u01 + u02 * u02, u10 * u10 + u11 * u11 + u12 * u12
        xy = u00 * u10 + u01 * u11 + u02 * u12

        # |U0 × U1|² equals xx·yy - xy² without the cancellation that makes thin splats singular in float32
        c0, c1, c2 = u01 * u12 - u02 * u11, u02 * u10 - u00 * u12, u00 * u11 - u01 * u10
        sharp = c0 * c0 + c1 * c1 + c2 * c2
        determinant = sharp + low_pass * (xx + yy + low_pass)
        xx, yy = xx + low_pass, yy + low_pass
        if antialiased:
            opacity = opacity * np.sqrt(sharp / determinant)
            if not opacity >= min_alpha:
                continue
        limit = two * np.log(opacity / min_alpha)
        reach_x, reach_y = np.sqrt(limit * xx), np.sqrt(limit * yy)
        if not (determinant < np.float32(1e30) and px + reach_x > half and px - reach_x < width - half):
            continue
        if not (py + reach_y > half and py - reach_y < height - half):
            continue
        inverse = one / determinant
        depths[i] = z
        covariances[i, 0], covariances[i, 1], covariances[i, 2] = xx, xy, yy
        splats[i, MEAN_X], splats[i, MEAN_Y] = px, py
        splats[i, CONIC_XX], splats[i, CONIC_XY], splats[i, CONIC_YY] = yy * inverse, -xy * inverse, xx * inverse
        splats[i, OPACITY], splats[i, DEPTH], splats[i, POWER_LIMIT] = opacity, z, limit


@numba.njit(cache=True, parallel=True)
def _gather(rows, splats, covariances, sorted_splats, sorted_covariances, places):
    for place in numba.prange(len(rows)):
        row = rows[place]
        places[row] = place
        for column in range(SPLAT_WIDTH):
            sorted_splats[place, column] = splats[row, column]
        for column in range(3):
            sorted_covariances[place, column] = covariances[row, column]
