"""Instance IDs made of any other numbers."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int, UInt32
from numpy import ndarray


def number_by_size(groups: Int[ndarray, " n"]) -> UInt32[ndarray, " n"]:
    """Number groups (negative = none, which becomes 0) 1, 2, … by falling count of Gaussians, then by group."""
    different, inverse, counts = np.unique(groups, return_inverse=True, return_counts=True)
    real = different >= 0
    order = np.lexsort((different[real], -counts[real]))
    numbers = np.zeros(len(different), np.uint32)
    numbers[np.flatnonzero(real)[order]] = np.arange(1, real.sum() + 1)
    return numbers[inverse]
