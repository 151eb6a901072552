"""Masks that may overlap become one label per pixel: small ones are painted over large ones."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, UInt32
from numpy import ndarray


class Painting:
    """A label map that masks are added to, in any order. Of masks of one size, the first is on top.

    Args:
        height: pixels.
        width: pixels.
    """

    def __init__(self, height: int, width: int) -> None:
        self.labels: UInt32[ndarray, "h w"] = np.zeros((height, width), np.uint32)
        """1 + position of the smallest mask in each pixel; 0 = none."""
        self._areas = np.full((height, width), height * width + 1, np.int64)
        self._count = 0

    def add(self, mask: Bool[ndarray, "h w"]) -> None:
        """The next mask."""
        self._count += 1
        area = int(np.count_nonzero(mask))
        is_top = mask & (area < self._areas)
        self.labels[is_top] = self._count
        self._areas[is_top] = area
