"""The one memory layout that the kernels are compiled for."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float32
from numpy import ndarray


def to_kernel_array(array: Float[ndarray, "*n"]) -> Float32[ndarray, "*n"]:
    """Convert an array to float32, C-contiguous and writeable; it is copied only where it is not.

    Any other layout, a read-only flag included, would make Numba compile every kernel anew: seconds for a copy of
    milliseconds.
    """
    return np.require(array, np.float32, ["C", "W"])
