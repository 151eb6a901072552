"""Per-splat arrays as 2-D textures: index i lies at texel (i mod width, i // width)."""

from __future__ import annotations

import moderngl
import numpy as np
from numpy import ndarray

WIDTH = 4096
"""Texels per row; a power of two that every OpenGL 3.3 driver takes. 16,384 rows of it hold 67 million texels."""

_DTYPES = {np.dtype(np.float32): "f4", np.dtype(np.uint8): "u1", np.dtype(np.uint16): "u2", np.dtype(np.uint32): "u4"}


class ArrayTexture:
    """An array of shape (n,) or (n, c ≤ 4), one texel per entry, fetched unfiltered."""

    def __init__(self, ctx: moderngl.Context, array: ndarray, normalized: bool = False) -> None:
        """Upload `array`; `normalized` makes uint8 read as [0, 1] floats instead of integers."""
        self._channels = 1 if array.ndim == 1 else array.shape[1]
        rows = max(1, -(-len(array) // WIDTH))
        dtype = "f1" if normalized else _DTYPES[array.dtype]
        self.texture = ctx.texture((WIDTH, rows), self._channels, alignment=1, dtype=dtype)
        self.texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self._capacity = rows * WIDTH
        self.write(array, 0, len(array))

    def write(self, array: ndarray, start: int, stop: int) -> None:
        """Upload entries `start` to `stop` of the whole `array`, rounded outwards to texture rows."""
        if stop <= start:
            return
        first, last = start // WIDTH, -(-stop // WIDTH)
        part = array[first * WIDTH : last * WIDTH]
        padded = np.zeros(((last - first) * WIDTH, self._channels), array.dtype)
        padded[: len(part)] = part.reshape(-1, self._channels)
        self.texture.write(padded, viewport=(0, first, WIDTH, last - first), alignment=1)

    def holds(self, count: int) -> bool:
        """Whether `count` entries fit."""
        return count <= self._capacity

    def release(self) -> None:
        """Free the texture."""
        self.texture.release()
