"""Large temporary arrays, kept from call to call: memory that is new to the process costs more than what fills it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

_spare: list[ndarray] = []
"""Buffers that nobody uses: at most as many as there were threads asking at once."""


@contextmanager
def borrow_floats(count: int) -> Iterator[Float32[ndarray, " count"]]:
    """`count` uninitialised float32, for as long as the scope lasts."""
    try:
        buffer = _spare.pop()
    except IndexError:
        buffer = np.empty(0, np.float32)
    if len(buffer) < count:
        buffer = np.empty(count + count // 8, np.float32)  # the next view may ask for a little more
    try:
        yield buffer[:count]
    finally:
        _spare.append(buffer)
