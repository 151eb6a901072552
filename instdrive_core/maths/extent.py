"""How far a cloud of points reaches, the strays left out."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Float64, Int64
from numpy import ndarray

MIN_ROWS = 20
"""Fewer points have no extent to measure others by."""
CORE_SHARE = 0.95
"""The share of points whose distance from the median is the radius."""


@dataclass(frozen=True)
class Extent:
    """How far some points reach from their middle."""

    rows: Int64[ndarray, " m"]
    """The points that were measured."""
    distances: Float64[ndarray, " m"]
    """Metres from the median of each axis."""
    radius: float
    """Metres that hold `CORE_SHARE` of them; above 0."""


def measure_extent(points: Float32[ndarray, "n 3"], rows: Int64[ndarray, " m"]) -> Extent | None:
    """Measure how far the points of these rows reach. None where too few of them, or most in one place, leave nothing
    to measure by.

    Args:
        points: in metres, finite in these rows.
        rows: the points to measure.
    """
    if len(rows) < MIN_ROWS:
        return None
    offsets = points[rows].astype(np.float64)
    offsets -= np.median(offsets, axis=0)
    distances = np.sqrt(np.einsum("ni,ni->n", offsets, offsets))
    radius = float(np.quantile(distances, CORE_SHARE))
    return Extent(rows, distances, radius) if radius > 0 else None
