"""What the sky adds behind the Gaussians: (1 - alpha) · sky(direction) per pixel, and the way back."""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from instdrive_core.rasterize.layout import kernel_array
from instdrive_core.scene.camera import Camera
from instdrive_core.scene.sky import Sky, cube_tap

_SHOWS = np.float32(1 / 1024)
"""Pixels that let less light through than this show no sky."""


def sky_behind(sky: Sky | None, camera: Camera, alpha: Float32[ndarray, "h w"]) -> Float32[ndarray, "h w 3"]:
    """The sky's colour along each pixel's ray, times 1 - alpha; black without a sky."""
    behind = np.zeros((*alpha.shape, 3), np.float32)
    if sky is not None:
        texels, resolution = kernel_array(sky.faces).reshape(-1, 3), sky.faces.shape[1]
        _behind(texels, resolution, _pinhole(camera), _rotation(camera), kernel_array(alpha), behind)
    return behind


def sky_behind_backward(
    sky: Sky, camera: Camera, alpha: Float32[ndarray, "h w"], grad: Float32[ndarray, "h w 3"]
) -> tuple[Float32[ndarray, "h w"], Float32[ndarray, "6 r r 3"]]:
    """Gradients with respect to alpha and faces, given the gradient with respect to what `sky_behind` returned."""
    grad_alpha, grad_faces = np.zeros(alpha.shape, np.float32), np.zeros(sky.faces.shape, np.float32)
    known = (kernel_array(grad), kernel_array(alpha), kernel_array(sky.faces).reshape(-1, 3), sky.faces.shape[1])
    _behind_backward(*known, _pinhole(camera), _rotation(camera), grad_alpha, grad_faces.reshape(-1, 3))
    return grad_alpha, grad_faces


def _pinhole(camera: Camera) -> ndarray:
    return np.array([camera.fx, camera.fy, camera.cx, camera.cy])


def _rotation(camera: Camera) -> ndarray:
    return np.ascontiguousarray(camera.world_from_camera[:3, :3])


@numba.njit(error_model="numpy", cache=True)
def _tap_of_pixel(row, column, pinhole, rotation, resolution, indices, weights):
    x, y = (column + 0.5 - pinhole[2]) / pinhole[0], (row + 0.5 - pinhole[3]) / pinhole[1]
    dx = rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2]
    dy = rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2]
    dz = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2]
    cube_tap(dx, dy, dz, resolution, indices, weights)


@numba.njit(parallel=True, error_model="numpy", cache=True)
def _behind(texels, resolution, pinhole, rotation, alpha, behind):
    height, width = alpha.shape
    for row in numba.prange(height):
        indices, weights = np.empty(4, np.int64), np.empty(4, np.float32)
        for column in range(width):
            through = np.float32(1) - alpha[row, column]
            if through < _SHOWS:
                continue
            _tap_of_pixel(row, column, pinhole, rotation, resolution, indices, weights)
            for k in range(4):
                for c in range(3):
                    behind[row, column, c] += through * weights[k] * texels[indices[k], c]


@numba.njit(error_model="numpy", cache=True)
def _behind_backward(grad, alpha, texels, resolution, pinhole, rotation, grad_alpha, grad_texels):
    """One thread: pixels share texels, and the order of the sums must not change."""
    height, width = alpha.shape
    indices, weights = np.empty(4, np.int64), np.empty(4, np.float32)
    for row in range(height):
        for column in range(width):
            through = np.float32(1) - alpha[row, column]
            if through < _SHOWS:
                continue
            _tap_of_pixel(row, column, pinhole, rotation, resolution, indices, weights)
            for k in range(4):
                for c in range(3):
                    value = grad[row, column, c] * weights[k]
                    grad_alpha[row, column] -= value * texels[indices[k], c]
                    grad_texels[indices[k], c] += value * through
