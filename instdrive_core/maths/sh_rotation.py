"""Rotating view-dependent colour: spherical harmonics under a rotation."""

from __future__ import annotations

from functools import cache

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

from instdrive_core.maths.spherical_harmonics import evaluate_rest_basis


def compute_rest_rotation(rotation: Float[ndarray, "3 3"], count: int) -> Float64[ndarray, "{count} {count}"]:
    """Compute the matrix M with rest' = M rest for a Gaussian turned by `rotation` (count = 0, 3, 8 or 15).

    A turned Gaussian shows along d what it showed along Rᵀ d: Y(d) M = Y(Rᵀ d) for all d, solved over fixed
    directions. The basis is closed under rotation, so the solution is exact up to rounding.
    """
    directions, inverse = _build_probe(count)
    return inverse @ evaluate_rest_basis(directions @ rotation, count)


def rotate_rest(sh_rest: Float[ndarray, "n k 3"], rotation: Float[ndarray, "3 3"]) -> Float[ndarray, "n k 3"]:
    """Rotate the coefficients of Gaussians that are turned together by `rotation`."""
    matrix = compute_rest_rotation(rotation, sh_rest.shape[1])
    return np.einsum("ij,njc->nic", matrix, sh_rest).astype(sh_rest.dtype)


@cache
def _build_probe(count: int) -> tuple[Float64[ndarray, "m 3"], Float64[ndarray, "{count} m"]]:
    """Build 64 directions over the sphere (a Fibonacci lattice) and the pseudo-inverse of the basis at them."""
    steps = np.arange(64) + 0.5
    height, angle = 1 - 2 * steps / 64, np.pi * (1 + np.sqrt(5)) * steps
    radius = np.sqrt(1 - height**2)
    directions = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)
    basis = evaluate_rest_basis(directions, count)
    return directions, np.linalg.pinv(basis) if count else basis.T
