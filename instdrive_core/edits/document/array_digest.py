"""Digests of large arrays at the speed of memory: asking whether a million splats have changed must take no frame."""

from __future__ import annotations

from typing import no_type_check

import numba
import numpy as np
from numpy import ndarray

_LANES = 16
"""Words of 8 bytes that are mixed side by side, in one or two vector registers."""
_FACTOR = np.uint64(0x9E3779B97F4A7C15)
"""An odd number: multiplying by it loses nothing."""


def digest_array(array: ndarray) -> bytes:
    """Digest the bytes of an array: 8 for each of 16 lanes, then the bytes behind the last whole row of lanes.

    Arrays of one length that differ in one word of a lane never have equal digests, others hardly ever (1 in 2^64):
    each step is a bijection of the word and of what was mixed before. It is no protection against whoever wants two
    arrays to look alike.
    """
    data = np.ascontiguousarray(array).reshape(-1).view(np.uint8)
    whole = len(data) // (8 * _LANES) * (8 * _LANES)
    lanes = np.zeros(_LANES, np.uint64)
    _mix(data[:whole].view(np.uint64), lanes)
    return lanes.tobytes() + data[whole:].tobytes()


@numba.njit(cache=True, nogil=True, error_model="numpy")
@no_type_check
def _mix(words: ndarray, lanes: ndarray) -> None:
    for row in range(np.uint64(len(words) // _LANES)):
        start = row * np.uint64(_LANES)
        for lane in range(np.uint64(_LANES)):
            mixed = (lanes[lane] ^ words[start + lane]) * _FACTOR
            lanes[lane] = mixed ^ (mixed >> np.uint64(32))
