"""Voxel consistency: Gaussians of one voxel should agree on their feature (InstDrive, sec. 3.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
import torch
from jaxtyping import Float, Int, UInt16
from numpy import ndarray
from torch import Tensor


@dataclass(frozen=True)
class Voxels:
    """Gaussians sorted by voxel: those of voxel v are `order[starts[v]:starts[v + 1]]`."""

    order: Int[ndarray, " n"]
    starts: Int[ndarray, " v1"]


def occupied_voxels(
    positions: Float[ndarray, "n 3"], nodes: UInt16[ndarray, " n"], size: float, offset: Float[ndarray, "3"]
) -> Voxels:
    """Group Gaussians by the voxel of their own node's frame; `offset` (metres) shifts the grid of cells of `size`."""
    cells = np.floor((positions + offset) / size).astype(np.int64)
    cells -= cells.min(axis=0, initial=0)
    extent = cells.max(axis=0, initial=0) + 1
    keys = ((nodes.astype(np.int64) * extent[0] + cells[:, 0]) * extent[1] + cells[:, 1]) * extent[2] + cells[:, 2]
    order = np.argsort(keys, kind="stable")
    ordered = keys[order]
    starts = np.flatnonzero(np.concatenate([[True], ordered[1:] != ordered[:-1]])) if len(keys) else np.zeros(0, int)
    return Voxels(order, np.append(starts, len(keys)))


def voxel_loss(features: Float[Tensor, "n d"], voxels: Voxels) -> Float[Tensor, ""]:
    """(1/|V|) Σ_v (1/|G_v|) Σ_g ‖f_g - mean_v‖² over occupied voxels, O(N) in memory."""
    return _VoxelLoss.apply(features, voxels)


class _VoxelLoss(torch.autograd.Function):
    @staticmethod
    def forward(ctx, features: Tensor, voxels: Voxels) -> Tensor:
        values = features.detach().numpy()
        losses, grad = _spread(values, voxels.order, voxels.starts)
        ctx.grad = torch.from_numpy(grad)
        return torch.tensor(losses.sum() / max(len(losses), 1), dtype=features.dtype)

    @staticmethod
    def backward(ctx, grad: Tensor) -> tuple[Tensor, None]:
        return ctx.grad * grad, None


@numba.njit(parallel=True, cache=True)
def _spread(values, order, starts):
    """Each voxel's mean squared distance to its mean, and the gradient of their average. The part of the gradient
    that passes through the mean sums to zero."""
    count, dim = values.shape
    voxels = len(starts) - 1
    losses = np.zeros(voxels, np.float64)
    grad = np.empty((count, dim), values.dtype)
    for v in numba.prange(voxels):
        start, stop = starts[v], starts[v + 1]
        mean = np.zeros(dim, np.float64)
        for k in range(start, stop):
            for c in range(dim):
                mean[c] += values[order[k], c]
        scale = 1.0 / (stop - start)
        spread = 0.0
        for k in range(start, stop):
            for c in range(dim):
                difference = values[order[k], c] - mean[c] * scale
                spread += difference * difference
                grad[order[k], c] = 2.0 * difference * scale / voxels
        losses[v] = spread * scale
    return losses, grad
