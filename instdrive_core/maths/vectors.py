"""Vectors as values that can be compared, hashed and written as JSON."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray

Vector = tuple[float, float, float]


def to_vector(array: Float[ndarray, "3"]) -> Vector:
    """Convert an array into a vector."""
    x, y, z = np.asarray(array, np.float64).tolist()
    return x, y, z
