"""Voxel consistency: Gaussians of one voxel should agree on their feature (InstDrive, sec. 3.2)."""

from __future__ import annotations

from typing import no_type_check

import numba
import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from instdrive_core.training.voxels import Voxels

_CHUNK = 1 << 9
"""Voxels that one thread takes at a time."""


def voxel_loss(
    features: Float[Tensor, "n d"], voxels: Voxels, weight: float = 1.0, tanh: bool = False
) -> tuple[float, Float[Tensor, "n d"]]:
    """`weight` · (1/|V|) Σ_v (1/|G_v|) Σ_g ‖f_g - mean_v‖² over occupied voxels, and its gradient, O(N) in memory.

    The gradient comes with the loss because every Gaussian has one: automatic differentiation would pass over all
    features several times more. With `tanh` the loss acts on tanh of the features.
    """
    values = features.detach().cpu()
    values = (torch.tanh(values) if tanh else values).numpy()
    losses = np.zeros((len(voxels.starts) + _CHUNK - 2) // _CHUNK, np.float64)
    grad = np.empty(values.shape, values.dtype)
    scale = weight / max(len(voxels.starts) - 1, 1)
    _spread(values, voxels.order, voxels.starts, values.dtype.type(scale), tanh, losses, grad)
    return float(losses.sum() * scale), torch.from_numpy(grad).to(features.device)


@numba.njit(parallel=True, cache=True, error_model="numpy", fastmath={"nsz", "arcp", "contract", "reassoc"})
@no_type_check
def _spread(values, order, starts, scale, tanh, losses, grad):
    """Sums each voxel's mean squared distance to its mean by chunks. The part of the gradient that passes through the
    mean sums to zero; that of tanh is 1 - tanh²."""
    dim, one = np.uint64(values.shape[1]), values.dtype.type(1)
    for chunk in numba.prange(len(losses)):
        mean = np.empty(values.shape[1], values.dtype)
        total = 0.0
        for v in range(chunk * _CHUNK, min(len(starts) - 1, (chunk + 1) * _CHUNK)):
            first, stop = np.uint64(starts[v]), np.uint64(starts[v + 1])
            share = one / values.dtype.type(stop - first)
            for c in range(dim):
                mean[c] = 0
            for k in range(first, stop):
                row = np.uint64(order[k])
                for c in range(dim):
                    mean[c] += values[row, c]
            for c in range(dim):
                mean[c] *= share
            double, spread = 2 * scale * share, values.dtype.type(0)
            for k in range(first, stop):
                row = np.uint64(order[k])
                for c in range(dim):
                    value = values[row, c]
                    difference = value - mean[c]
                    spread += difference * difference
                    slope = one - value * value if tanh else one
                    grad[row, c] = double * difference * slope
            total += spread * share
        losses[chunk] = total
