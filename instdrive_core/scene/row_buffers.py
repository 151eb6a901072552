"""Arrays that grow at their end without being copied every time."""

from __future__ import annotations

from weakref import WeakValueDictionary

import numpy as np
from numpy import ndarray
from numpy.typing import DTypeLike

SPARE_SHARE = 8
"""A new buffer has room for one more row per so many."""
_UNOWNED: WeakValueDictionary[int, ndarray] = WeakValueDictionary()
"""Buffers behind arrays `allocate_with_spare`, by their addresses, until one of `RowBuffers` takes them."""


def allocate_with_spare(shape: tuple[int, ...], dtype: DTypeLike) -> ndarray:
    """Allocate an array that can grow without a copy: spare memory lies behind its end, taken only when written."""
    buffer = np.empty((shape[0] + shape[0] // SPARE_SHARE, *shape[1:]), dtype)
    _UNOWNED[id(buffer)] = buffer
    return buffer[: shape[0]]


class RowBuffers:
    """Buffers behind named arrays: an array is the front of its buffer, and rows are written behind it."""

    def __init__(self) -> None:
        self._buffers: dict[str, ndarray] = {}
        self.writes = 0
        """How often something was written behind an array's end."""

    def extend(self, name: str, array: ndarray, tail: ndarray, grown: ndarray | None = None) -> ndarray:
        """Append the rows of `tail` to `array`; the result shares its memory where it came from here and has room.

        Views taken of a longer array before rows were dropped and others appended see the new rows.

        Args:
            grown: What `grow` made for just these.
        """
        buffer = self.grow(name, array, tail) if grown is None else grown
        _UNOWNED.pop(id(buffer), None)
        self._buffers[name] = buffer
        return buffer[: len(array) + len(tail)]

    def grow(self, name: str, array: ndarray, tail: ndarray) -> ndarray:
        """Make the buffer that `extend` would use, with all rows written.

        That is nearly all the work of it, and changes nothing that is in use: another thread may do it, as long as
        nobody extends the array meanwhile.
        """
        self.writes += 1
        count, total = len(array), len(array) + len(tail)
        buffer = self._buffers.get(name)
        if buffer is None and array.base is not None and _UNOWNED.get(id(array.base)) is array.base:
            buffer = array.base
        # Only a buffer that was made for this may be written behind the array's end: what lies there is nobody's.
        if buffer is None or array.base is not buffer or len(buffer) < total:
            buffer = np.empty((total + count // SPARE_SHARE, *array.shape[1:]), array.dtype)
            buffer[:count] = array
        buffer[count:total] = tail
        return buffer

    def find(self, name: str, array: ndarray) -> ndarray | None:
        """Find the buffer whose front an array is; None where that was not made here."""
        buffer = self._buffers.get(name)
        return buffer if buffer is not None and array.base is buffer else None
