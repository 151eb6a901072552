"""Shape around each point of a cloud: a surface or scattered points, and which way the surface faces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32
from numpy import ndarray
from scipy.spatial import KDTree

NEIGHBOURS = 24


@dataclass(frozen=True)
class PointShape:
    """Shares of the neighbours' covariance (Weinmann et al., ISPRS J. 105, 2015), averaged over the neighbours."""

    scatter: Float32[ndarray, " n"]
    """Thickness ÷ length: 0 on a surface or line, near 1 where points lie everywhere."""
    upright: Float32[ndarray, " n"]
    """Share of the neighbours whose surface is vertical."""


def compute_point_shape(points: Float32[ndarray, "n 3"]) -> PointShape:
    """Compute the shape around each point from its nearest neighbours."""
    if len(points) < NEIGHBOURS:
        return PointShape(np.zeros(len(points), np.float32), np.zeros(len(points), np.float32))
    _, neighbours = KDTree(points).query(points, NEIGHBOURS)
    around = points[neighbours]
    around -= around.mean(axis=1, keepdims=True)
    covariance = around.transpose(0, 2, 1) @ around / NEIGHBOURS
    sizes, directions = np.linalg.eigh(covariance)
    scatter = np.sqrt(np.maximum(sizes[:, 0], 0) / np.maximum(sizes[:, 2], 1e-12))
    upright = (np.abs(directions[:, 2, 0]) < 0.35).astype(np.float32)
    return PointShape(
        scatter[neighbours].mean(axis=1).astype(np.float32), upright[neighbours].mean(axis=1).astype(np.float32)
    )
