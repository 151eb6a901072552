"""How well a point that stands still explains the path of a corner, given the cameras' poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.scene.camera import Camera
from instdrive_core.tracks.photos.feature_paths import FeaturePaths

NEAREST = 1.0
"""Metres along the viewing ray; nothing outside of the recording car is nearer."""
_GUESSES = 64


@dataclass(frozen=True)
class StaticFit:
    """The best standing point of each path."""

    residuals: Float64[ndarray, " n"]
    """Root of the mean squared distance between path and projected point, pixels."""
    inverse_depths: Float64[ndarray, " n"]
    """Along the optical axis of the photo in the path's middle, 1/m."""
    deviations: Float64[ndarray, " n"]
    """Standard deviation of the inverse depth for an error of one pixel, 1/m; infinite without parallax."""
    points: Float64[ndarray, "n 3"]
    """World position; what is farther than a kilometre is put there."""
    rays: Float64[ndarray, "n 3"]
    """Viewing direction in the world per metre along the optical axis of the photo in the path's middle."""
    origins: Float64[ndarray, "n 3"]
    """Position of that photo's camera."""


def fit_standing_points(
    paths: FeaturePaths, cameras: Sequence[Camera], least: Float64[ndarray, " n"] | None = None
) -> StaticFit:
    """Fit a standing point to each path.

    Args:
        paths: paths through the photos of these cameras.
        cameras: camera of each photo.
        least: smallest inverse depth that is allowed; None = 0, infinitely far.
    """
    matrices = np.stack([camera.camera_from_world[:3] for camera in cameras])
    intrinsics = np.array([[camera.fx, camera.fy, camera.cx, camera.cy] for camera in cameras])
    floor = np.zeros(len(paths)) if least is None else least
    return StaticFit(
        *_fit(paths.starts, paths.photos, paths.places.astype(np.float64), matrices, intrinsics, floor, 1 / NEAREST)
    )


@numba.njit(cache=True, parallel=True, error_model="numpy")
def _fit(starts, photos, places, matrices, intrinsics, floors, most):
    count = len(starts) - 1
    residuals, inverse = np.empty(count), np.empty(count)
    deviations, points = np.empty(count), np.empty((count, 3))
    rays, origins = np.empty((count, 3)), np.empty((count, 3))
    for path in numba.prange(count):
        first, last = starts[path], starts[path + 1]
        middle = (first + last) // 2
        photo = photos[middle]
        matrix = matrices[photo]
        u = (places[middle, 0] - intrinsics[photo, 2]) / intrinsics[photo, 0]
        v = (places[middle, 1] - intrinsics[photo, 3]) / intrinsics[photo, 1]
        origin, ray = np.zeros(3), np.zeros(3)
        for axis in range(3):
            ray[axis] = matrix[0, axis] * u + matrix[1, axis] * v + matrix[2, axis]
            for row in range(3):
                origin[axis] -= matrix[row, axis] * matrix[row, 3]
        floor = min(floors[path], most)
        best, chosen = np.inf, floor
        for guess in range(_GUESSES):
            share = guess / (_GUESSES - 1)
            rho = floor + (most - floor) * share * share * share
            error = _measure(rho, first, last, photos, places, matrices, intrinsics, origin, ray)[0]
            if error < best:
                best, chosen = error, rho
        for _ in range(8):
            error, slope, curvature = _measure(chosen, first, last, photos, places, matrices, intrinsics, origin, ray)
            if curvature <= 0:
                break
            rho = min(max(chosen - slope / curvature, floor), most)
            better = _measure(rho, first, last, photos, places, matrices, intrinsics, origin, ray)[0]
            if better >= error:
                break
            best, chosen = better, rho
        curvature = _measure(chosen, first, last, photos, places, matrices, intrinsics, origin, ray)[2]
        residuals[path] = np.sqrt(best / (last - first - 1))
        inverse[path] = chosen
        deviations[path] = 1 / np.sqrt(curvature) if curvature > 0 else np.inf
        points[path] = origin + ray / max(chosen, 1e-3)
        rays[path], origins[path] = ray, origin
    return residuals, inverse, deviations, points, rays, origins


@numba.njit(cache=True, error_model="numpy")
def _measure(rho, first, last, photos, places, matrices, intrinsics, origin, ray):
    """Sum of squared distances in pixels, half its slope and curvature (Gauss-Newton) by inverse depth."""
    total, slope, curvature = 0.0, 0.0, 0.0
    for entry in range(first, last):
        photo = photos[entry]
        matrix = matrices[photo]
        x, y, z = 0.0, 0.0, 0.0
        ox, oy, oz = matrix[0, 3], matrix[1, 3], matrix[2, 3]
        for axis in range(3):
            x += matrix[0, axis] * ray[axis]
            y += matrix[1, axis] * ray[axis]
            z += matrix[2, axis] * ray[axis]
            ox += matrix[0, axis] * origin[axis]
            oy += matrix[1, axis] * origin[axis]
            oz += matrix[2, axis] * origin[axis]
        depth = z + rho * oz
        if depth <= 0.02:
            return np.inf, 0.0, 0.0
        u, v = (x + rho * ox) / depth, (y + rho * oy) / depth
        du = intrinsics[photo, 0] * (u - (places[entry, 0] - intrinsics[photo, 2]) / intrinsics[photo, 0])
        dv = intrinsics[photo, 1] * (v - (places[entry, 1] - intrinsics[photo, 3]) / intrinsics[photo, 1])
        ju = intrinsics[photo, 0] * (ox - u * oz) / depth
        jv = intrinsics[photo, 1] * (oy - v * oz) / depth
        total += du * du + dv * dv
        slope += ju * du + jv * dv
        curvature += ju * ju + jv * jv
    return total, slope, curvature
