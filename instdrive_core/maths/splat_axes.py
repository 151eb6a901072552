"""How Gaussians lie in space: which way they face, and how high they reach."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float32, Float64
from numpy import ndarray

from instdrive_core.maths.rotations import matrix_from_quaternion

_BLOCK = 1 << 17
"""Gaussians whose axes are computed in one go: matrices of all would take ten times as much."""


def compute_normals(quats: Float32[ndarray, "n 4"], log_scales: Float32[ndarray, "n 3"]) -> Float64[ndarray, "n 3"]:
    """Compute the thinnest axis of each Gaussian, a unit vector of any sign."""
    normals = np.empty((len(quats), 3), np.float64)
    for block, axes in _compute_axes(quats):
        normals[block] = axes[np.arange(len(axes)), :, np.argmin(log_scales[block], axis=1)]
    return normals


def compute_thicknesses(quats: Float32[ndarray, "n 4"], log_scales: Float32[ndarray, "n 3"]) -> Float32[ndarray, " n"]:
    """Compute the standard deviation of each Gaussian along z, in the unit of its scales."""
    thicknesses = np.empty(len(quats), np.float32)
    for block, axes in _compute_axes(quats):
        thicknesses[block] = np.linalg.norm(axes[:, 2] * np.exp(log_scales[block]), axis=1)
    return thicknesses


def _compute_axes(quats: Float32[ndarray, "n 4"]) -> Iterator[tuple[slice, Float64[ndarray, "b 3 3"]]]:
    """Compute the axes, in columns, block by block."""
    for start in range(0, len(quats), _BLOCK):
        block = slice(start, min(start + _BLOCK, len(quats)))
        yield block, matrix_from_quaternion(quats[block].astype(np.float64))
