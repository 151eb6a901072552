"""Voxel consistency: Gaussians of one voxel should agree on their feature (InstDrive, sec. 3.2)."""

from __future__ import annotations

from typing import no_type_check

import numba
import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from instdrive_core.training.instances.voxels import Voxels

_CHUNK = 1 << 9
"""Voxels that one thread takes at a time."""


def voxel_loss(
    features: Float[Tensor, "n d"], voxels: Voxels, weight: float = 1.0, tanh: bool = False
) -> tuple[float, Float[Tensor, "n d"]]:
    """`weight` · (1/|V|) Σ_v (1/|G_v|) Σ_g ‖f_g - mean_v‖² over occupied voxels, and its gradient, O(N) in memory.

    The gradient comes with the loss because every Gaussian has one: automatic differentiation would pass over all
    features several times more. With `tanh` the loss acts on tanh of the features.
    """
    values = features.detach().cpu().numpy()
    losses = np.zeros((len(voxels.starts) + _CHUNK - 2) // _CHUNK, np.float64)
    grad = np.empty(values.shape, values.dtype)
    scale = weight / max(len(voxels.starts) - 1, 1)
    _sum_spread(values, voxels.order, voxels.starts, values.dtype.type(scale), tanh, losses, grad)
    return float(losses.sum() * scale), torch.from_numpy(grad).to(features.device)


_FLAT = np.float32(9)
"""tanh of more is 1 in float32."""
_PER_FLAT = np.float32(1 / 81)


def _tanh_coefficients(degree: int = 4) -> tuple[tuple[np.float32, ...], tuple[np.float32, ...]]:
    """Polynomials p and q in z = (x / _FLAT)² with tanh x = x · p(z) / q(z) to 3e-8 where |x| < _FLAT.

    Least squares; each round weighs the linearised error by the q of the round before. Lowest degree first.
    """
    x = _FLAT * np.sin(0.5 * np.pi * (np.arange(4000) + 0.5) / 4000)
    z, target, weight = (x / _FLAT) ** 2, np.tanh(x) / x, x / np.tanh(x)
    powers = np.vander(z, degree + 1, increasing=True)
    solution, q = np.zeros(2 * degree + 1), np.ones(degree + 1)
    for _ in range(6):
        system = np.hstack([powers, -target[:, None] * powers[:, 1:]]) * weight[:, None]
        solution = np.linalg.lstsq(system, target * weight, rcond=None)[0]
        q = np.append(1.0, solution[degree + 1 :])
        weight = 1 / (powers @ q * target)
    return tuple(np.float32(c) for c in solution[: degree + 1]), tuple(np.float32(c) for c in q)


(_P0, _P1, _P2, _P3, _P4), (_Q0, _Q1, _Q2, _Q3, _Q4) = _tanh_coefficients()


@numba.njit(cache=True, error_model="numpy", fastmath={"nsz", "arcp", "contract"})
@no_type_check
def _tanh(x):
    """tanh without a branch or a call, so that a loop of it vectorises."""
    x = min(max(x, -_FLAT), _FLAT)
    z = x * x * _PER_FLAT
    p = _P0 + z * (_P1 + z * (_P2 + z * (_P3 + z * _P4)))
    return x * p / (_Q0 + z * (_Q1 + z * (_Q2 + z * (_Q3 + z * _Q4))))


@numba.njit(parallel=True, cache=True, error_model="numpy", fastmath={"nsz", "arcp", "contract", "reassoc"})
@no_type_check
def _sum_spread(values, order, starts, scale, tanh, losses, grad):
    """Sums each voxel's mean squared distance to its mean by chunks. The part of the gradient that passes through the
    mean sums to zero; that of tanh is 1 - tanh². Until it is known, `grad` holds what the loss acts on."""
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
                    value = _tanh(values[row, c]) if tanh else values[row, c]
                    grad[row, c] = value
                    mean[c] += value
            for c in range(dim):
                mean[c] *= share
            double, spread = 2 * scale * share, values.dtype.type(0)
            for k in range(first, stop):
                row = np.uint64(order[k])
                for c in range(dim):
                    value = grad[row, c]
                    difference = value - mean[c]
                    spread += difference * difference
                    slope = one - value * value if tanh else one
                    grad[row, c] = double * difference * slope
            total += spread * share
        losses[chunk] = total
