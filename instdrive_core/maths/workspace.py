"""Memory kept from frame to frame: new pages of a process cost more than filling them."""

from __future__ import annotations

import math

import numpy as np
from numpy import ndarray
from numpy.typing import DTypeLike

_SPARE = 8
"""A new buffer has room for one more entry per so many: the next view may ask for a little more."""


class Workspace:
    """Named scratch arrays of one thread. What is in them lasts until the same name is asked for again."""

    def __init__(self) -> None:
        self._buffers: dict[str, ndarray] = {}

    def get_array(self, name: str, shape: tuple[int, ...], dtype: DTypeLike = np.float32) -> ndarray:
        """Get a C-contiguous array of this shape that begins with a cache line; its contents are undefined."""
        count, buffer = math.prod(shape), self._buffers.get(name)
        if buffer is None or len(buffer) < count or buffer.dtype != np.dtype(dtype):
            buffer = self._buffers[name] = _allocate_aligned(count + count // _SPARE, np.dtype(dtype))
        return buffer[:count].reshape(shape)

    def get_size(self, name: str) -> int:
        """Get the number of entries that fit under this name, 0 where it was never asked for."""
        buffer = self._buffers.get(name)
        return 0 if buffer is None else len(buffer)


def _allocate_aligned(count: int, dtype: np.dtype, line: int = 64) -> ndarray:
    raw = np.empty(count * dtype.itemsize + line, np.uint8)
    skip = -raw.ctypes.data % line
    return raw[skip : skip + count * dtype.itemsize].view(dtype)
