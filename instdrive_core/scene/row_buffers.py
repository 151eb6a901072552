"""Arrays that grow at their end without being copied every time."""

from __future__ import annotations

import numpy as np
from numpy import ndarray

SPARE_SHARE = 8
"""A new buffer has room for one more row per so many."""


class RowBuffers:
    """Buffers behind named arrays: an array is the front of its buffer, and rows are written behind it."""

    def __init__(self) -> None:
        self._buffers: dict[str, ndarray] = {}

    def extended(self, name: str, array: ndarray, tail: ndarray) -> ndarray:
        """`array` with the rows of `tail` after it: a view of the same memory where it came from here and has room.

        Views taken of a longer array before rows were dropped and others appended see the new rows.
        """
        count, total = len(array), len(array) + len(tail)
        buffer = self._buffers.get(name)
        # Only a buffer that was made here may be written behind the array's end: what lies there is nobody's.
        if buffer is None or array.base is not buffer or len(buffer) < total:
            buffer = np.empty((total + count // SPARE_SHARE, *array.shape[1:]), array.dtype)
            buffer[:count] = array
            self._buffers[name] = buffer
        buffer[count:total] = tail
        return buffer[:total]
