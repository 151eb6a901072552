"""The static binarised codebook C = {-1, 1}^d (InstDrive, sec. 3.3): features to codewords without a table."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, UInt32
from numpy import ndarray

MAX_BITS = 32


def quantize_features(features: Float[ndarray, "*n d"]) -> UInt32[ndarray, "*n"]:
    """Compute the number of the nearest codeword, ID(f) = Σ_k 2^k [f_k > 0].

    It equals the argmin of ‖tanh f - c‖² over the codebook. Raises ValueError for a dimension that no codeword has.
    """
    bits = features.shape[-1]
    if not 0 < bits <= MAX_BITS:
        raise ValueError(f"feature dimension is {bits}, the codebook takes 1 to {MAX_BITS}")
    powers = np.left_shift(np.uint32(1), np.arange(bits, dtype=np.uint32))
    return ((features > 0) * powers).sum(axis=-1, dtype=np.uint32)


def decode_codewords(codewords: UInt32[ndarray, "*n"], bits: int) -> Float[ndarray, "*n {bits}"]:
    """Decode codeword numbers into their ±1 vectors, float32."""
    set_bits = (np.asarray(codewords, np.uint32)[..., None] >> np.arange(bits, dtype=np.uint32)) & 1
    return set_bits.astype(np.float32) * 2 - 1
