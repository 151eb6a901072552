"""The RGB stage's other terms on the CPU: LiDAR depth and opacity, with their gradients."""

from __future__ import annotations

import numba
import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from numpy import ndarray
from torch import Tensor
from torch.autograd.function import once_differentiable

from instdrive_core.rasterize.kernels.layout import to_kernel_array

_DRAWN = np.float32(0.05)
"""Pixels with less opacity than this have no expected depth."""
_FLOOR = np.float32(1e-4)
"""Keeps the logarithm of the opacity terms finite where alpha is the very opposite of what is wanted."""
_FACTORS = 64
"""Numbers in [1e-4, 1] whose product is taken before its logarithm: it stays above 1e-256."""


def depth_loss(
    depth: Float[Tensor, "h w"],
    alpha: Float[Tensor, "h w"],
    pixels: Int[ndarray, " k"],
    lidar_depths: Float[ndarray, " k"],
) -> Float[Tensor, ""]:
    """Mean |expected depth - LiDAR depth| in metres over the given flat pixels where something is drawn; 0 if none.

    Args:
        depth: Σ w·z, not divided by alpha.
    """
    return _DepthLoss.apply(depth, alpha, np.require(pixels, np.int32, ["C", "W"]), to_kernel_array(lidar_depths))


def opacity_loss(alpha: Float[Tensor, "h w"], pixels: Bool[ndarray, "h w"], solid: bool) -> Float[Tensor, ""]:
    """Binary cross-entropy of alpha towards 1 (`solid`) or 0 in the given pixels, averaged over the whole image."""
    return _EmptyLoss.apply(1 - alpha if solid else alpha, np.require(pixels, np.bool_, ["C", "W"]))


class _DepthLoss(torch.autograd.Function):
    @staticmethod
    def forward(ctx, depth, alpha, pixels, lidar_depths):
        ctx.save_for_backward(depth, alpha)
        ctx.lidar = pixels, lidar_depths
        total, ctx.count = _depth_errors(_flat(depth), _flat(alpha), pixels, lidar_depths)
        return torch.tensor(total / max(ctx.count, 1), dtype=torch.float32)

    @staticmethod
    @once_differentiable
    def backward(ctx, grad_loss):  # pyright: ignore[reportIncompatibleMethodOverride]
        depth, alpha = ctx.saved_tensors
        grad_depth, grad_alpha = np.zeros(tuple(depth.shape), np.float32), np.zeros(tuple(depth.shape), np.float32)
        scale = np.float32(float(grad_loss) / max(ctx.count, 1))
        pixels, lidar_depths = ctx.lidar
        grads = grad_depth.reshape(-1), grad_alpha.reshape(-1)
        _depth_gradient(_flat(depth), _flat(alpha), pixels, lidar_depths, scale, *grads)
        return torch.from_numpy(grad_depth), torch.from_numpy(grad_alpha), None, None


class _EmptyLoss(torch.autograd.Function):
    @staticmethod
    def forward(ctx, alpha, pixels):
        ctx.save_for_backward(alpha)
        ctx.pixels = pixels
        costs = np.empty(len(pixels), np.float64)
        _empty_costs(to_kernel_array(alpha.detach().numpy()), pixels, costs)
        return torch.tensor(costs.sum() / alpha.numel(), dtype=torch.float32)

    @staticmethod
    @once_differentiable
    def backward(ctx, grad_loss):  # pyright: ignore[reportIncompatibleMethodOverride]
        (alpha,) = ctx.saved_tensors
        grad_alpha = np.empty(tuple(alpha.shape), np.float32)
        scale = np.float32(float(grad_loss) / alpha.numel())
        _empty_gradient(to_kernel_array(alpha.detach().numpy()), ctx.pixels, scale, grad_alpha)
        return torch.from_numpy(grad_alpha), None


def _flat(tensor: Tensor) -> Float[ndarray, " n"]:
    return to_kernel_array(tensor.detach().numpy()).reshape(-1)


@numba.njit(error_model="numpy", cache=True)
def _depth_errors(depth, alpha, pixels, lidar_depths):
    """Sum of the absolute errors and how many there are. One thread: a sweep hits a few thousand pixels."""
    total, count = 0.0, 0
    for k in range(len(pixels)):
        pixel = pixels[k]
        if alpha[pixel] > _DRAWN:
            total += abs(depth[pixel] / alpha[pixel] - lidar_depths[k])
            count += 1
    return total, count


@numba.njit(error_model="numpy", cache=True)
def _depth_gradient(depth, alpha, pixels, lidar_depths, scale, grad_depth, grad_alpha):
    for k in range(len(pixels)):
        pixel = pixels[k]
        if alpha[pixel] > _DRAWN:
            expected = depth[pixel] / alpha[pixel]
            by_expected = scale * np.sign(expected - lidar_depths[k])
            grad_depth[pixel] += by_expected / alpha[pixel]
            grad_alpha[pixel] -= by_expected * expected / alpha[pixel]


@numba.njit(error_model="numpy", cache=True)
def _empty_cost_of_row(alpha, pixels):
    """-Σ log through, with one logarithm for many factors."""
    cost, product, factors = 0.0, 1.0, 0
    for column in range(len(alpha)):
        if pixels[column]:
            product *= max(np.float32(1) - alpha[column], _FLOOR)
            factors += 1
            if factors == _FACTORS:
                cost, product, factors = cost - np.log(product), 1.0, 0
    return cost - np.log(product)


@numba.njit(parallel=True, error_model="numpy", cache=True)
def _empty_costs(alpha, pixels, costs):
    for row in numba.prange(len(alpha)):
        costs[row] = _empty_cost_of_row(alpha[row], pixels[row])


@numba.njit(parallel=True, error_model="numpy", cache=True)
def _empty_gradient(alpha, pixels, scale, grad_alpha):
    for row in numba.prange(len(alpha)):
        for column in range(alpha.shape[1]):
            through = np.float32(1) - alpha[row, column]
            counts = pixels[row, column] and through >= _FLOOR
            grad_alpha[row, column] = scale / through if counts else np.float32(0)
