"""Morton (Z-order) codes: points near each other along the codes are near each other in space."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, UInt64
from numpy import ndarray

AXIS_BITS = 21
"""Three axes fill 63 bits: cells of 5 mm in a scene of 10 km."""
_SPREADING = (
    (32, 0x001F00000000FFFF),
    (16, 0x001F0000FF0000FF),
    (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)


def compute_morton_codes(
    points: Float[ndarray, "n 3"], low: Float[ndarray, "3"], high: Float[ndarray, "3"]
) -> UInt64[ndarray, " n"]:
    """Compute the code of each finite point in the box from `low` to `high`; points outside count as on its side."""
    sizes = np.maximum(np.asarray(high, np.float64) - low, np.finfo(np.float64).tiny)
    cells = (1 << AXIS_BITS) - 1
    codes = np.zeros(len(points), np.uint64)
    for axis in range(3):
        place = np.clip((points[:, axis].astype(np.float64) - low[axis]) / sizes[axis], 0, 1)
        codes |= _spread_bits((place * cells).astype(np.uint64)) << np.uint64(axis)
    return codes


def _spread_bits(values: UInt64[ndarray, " n"]) -> UInt64[ndarray, " n"]:
    """Put two zero bits between the 21 bits of each value (Warren, Hacker's Delight, ch. 7)."""
    for shift, mask in _SPREADING:
        values = (values | values << np.uint64(shift)) & np.uint64(mask)
    return values
