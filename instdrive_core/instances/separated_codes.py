"""Distinct codewords for a known number of instances, any two of which differ in at least four bits.

An extended Hamming code (Hamming 1950), shortened to as many data bits as the count needs: one wrong bit of a blended
feature still lies nearest to its own codeword, and two wrong ones never look like another instance's.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import UInt32
from numpy import ndarray

from instdrive_core.instances.codebook import MAX_BITS

MIN_DISTANCE = 4
_MAX_DATA_BITS = 26
"""Data bits of an extended Hamming code of 32 bits."""


def generate_separated_codewords(count: int) -> tuple[UInt32[ndarray, " count"], int]:
    """Generate `count` codewords of d bits, the fewest that keep them apart; returns the codewords and d.

    Raises ValueError for more instances than 32 bits hold (2^26).
    """
    data_bits = max(1, (max(count, 1) - 1).bit_length())
    if data_bits > _MAX_DATA_BITS:
        raise ValueError(f"{count} instances do not fit into {MAX_BITS} bits with distance {MIN_DISTANCE}")
    check_bits = next(r for r in range(2, MAX_BITS) if 2**r >= data_bits + r + 1)
    positions = [p for p in range(1, data_bits + check_bits + 1) if p & (p - 1)]  # data lies off the powers of two
    data = np.arange(count, dtype=np.uint32)
    codes, syndrome = np.zeros(count, np.uint32), np.zeros(count, np.uint32)
    for bit, position in enumerate(positions):
        value = (data >> np.uint32(bit)) & np.uint32(1)
        codes |= value << np.uint32(position - 1)
        syndrome ^= value * np.uint32(position)
    for check in range(check_bits):
        codes |= ((syndrome >> np.uint32(check)) & np.uint32(1)) << np.uint32((1 << check) - 1)
    bits = data_bits + check_bits + 1
    codes |= _compute_parity(codes) << np.uint32(bits - 1)
    return codes, bits


def _compute_parity(codes: UInt32[ndarray, " n"]) -> UInt32[ndarray, " n"]:
    folded = codes.copy()
    for shift in (16, 8, 4, 2, 1):
        folded ^= folded >> np.uint32(shift)
    return folded & np.uint32(1)
