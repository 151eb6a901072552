"""The sky behind the Gaussians: image + (1 - alpha) · sky(direction), with gradients to image, alpha and texels."""

from __future__ import annotations

import numba
import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from instdrive_core.scene.camera import Camera
from instdrive_core.scene.sky import cube_tap

_SHOWS = np.float32(0.004)
"""Pixels whose background carries less weight than this (1/255) read no sky."""


def over_sky(
    image: Float[Tensor, "h w 3"], alpha: Float[Tensor, "h w"], faces: Float[Tensor, "6 r r 3"], camera: Camera
) -> Float[Tensor, "h w 3"]:
    """Composite the cube map (see `scene/sky.py`) behind a rendered image."""
    return _OverSky.apply(image, alpha, faces, camera)


class _OverSky(torch.autograd.Function):
    @staticmethod
    def forward(ctx, image: Tensor, alpha: Tensor, faces: Tensor, camera: Camera) -> Tensor:
        ctx.save_for_backward(alpha, faces)
        ctx.camera = camera
        out = image.detach().numpy().copy()
        rotation, resolution = camera.world_from_camera[:3, :3], faces.shape[1]
        _blend(out, alpha.detach().numpy(), _texels(faces), resolution, _pinhole(camera), rotation)
        return torch.from_numpy(out)

    @staticmethod
    def backward(ctx, grad: Tensor) -> tuple[Tensor, Tensor, Tensor, None]:
        alpha, faces = ctx.saved_tensors
        grad_alpha = np.zeros(alpha.shape, np.float32)
        grad_texels = np.zeros(_texels(faces).shape, np.float32)
        rotation, resolution = ctx.camera.world_from_camera[:3, :3], faces.shape[1]
        known = (grad.contiguous().numpy(), alpha.detach().numpy(), _texels(faces), resolution)
        _blend_backward(*known, _pinhole(ctx.camera), rotation, grad_alpha, grad_texels)
        return grad, torch.from_numpy(grad_alpha), torch.from_numpy(grad_texels).reshape(faces.shape), None


def _texels(faces: Tensor) -> np.ndarray:
    return faces.detach().numpy().reshape(-1, 3)


def _pinhole(camera: Camera) -> np.ndarray:
    return np.array([camera.fx, camera.fy, camera.cx, camera.cy])


@numba.njit(error_model="numpy", cache=True)
def _tap_of_pixel(row, column, pinhole, rotation, resolution, indices, weights):
    x, y = (column + 0.5 - pinhole[2]) / pinhole[0], (row + 0.5 - pinhole[3]) / pinhole[1]
    dx = rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2]
    dy = rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2]
    dz = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2]
    cube_tap(dx, dy, dz, resolution, indices, weights)


@numba.njit(parallel=True, error_model="numpy", cache=True)
def _blend(image, alpha, texels, resolution, pinhole, rotation):
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
                    image[row, column, c] += through * weights[k] * texels[indices[k], c]


@numba.njit(error_model="numpy", cache=True)
def _blend_backward(grad, alpha, texels, resolution, pinhole, rotation, grad_alpha, grad_texels):
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
