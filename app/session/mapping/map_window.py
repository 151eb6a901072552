"""The part of the ground that the map shows: which place is which pixel."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

FINEST, COARSEST = 0.002, 200.0
"""Metres that a pixel may be."""
MARGIN = 0.06
"""Share of the map that stays free on each side where it is fitted to places."""


@dataclass(frozen=True)
class MapWindow:
    """A rectangle of the ground: x to the right, y up, both along the scene's axes."""

    x: float
    y: float
    """The place in the middle, metres."""
    scale: float
    """Metres to a pixel."""
    width: int
    height: int
    """Pixels."""

    def to_pixels(self, places: Float[ndarray, "n d"]) -> Float64[ndarray, "n 2"]:
        """Convert places (metres; only x and y count) to pixels from the top left."""
        flat = np.asarray(places, np.float64)[:, :2]
        return (flat - (self.x, self.y)) / self.scale * (1, -1) + (self.width / 2, self.height / 2)

    def to_place(self, x: float, y: float) -> tuple[float, float]:
        """Convert a pixel to a place, metres."""
        return self.x + (x - self.width / 2) * self.scale, self.y - (y - self.height / 2) * self.scale

    def resize(self, width: int, height: int) -> MapWindow:
        """Show the same middle at the same scale in another size (pixels)."""
        return replace(self, width=max(width, 1), height=max(height, 1))

    def drag(self, dx: float, dy: float) -> MapWindow:
        """Follow a drag by so many pixels."""
        return replace(self, x=self.x - dx * self.scale, y=self.y + dy * self.scale)

    def zoom(self, factor: float, x: float, y: float) -> MapWindow:
        """Make a pixel `factor` times as many metres; the place at the pixel (x, y) stays there."""
        place = self.to_place(x, y)
        scaled = replace(self, scale=min(max(self.scale * factor, FINEST), COARSEST))
        there = scaled.to_place(x, y)
        return replace(scaled, x=scaled.x + place[0] - there[0], y=scaled.y + place[1] - there[1])


def fit_map(places: Float[ndarray, "n d"], width: int, height: int) -> MapWindow:
    """Fit a window of this size (pixels) around places (metres; at least one), with a margin."""
    flat = np.asarray(places, np.float64)[:, :2]
    low, high = flat.min(axis=0), flat.max(axis=0)
    room = 1 - 2 * MARGIN
    scale = float(np.max((high - low) / (max(width, 1) * room, max(height, 1) * room)))
    x, y = ((low + high) / 2).tolist()
    return MapWindow(x, y, min(max(scale, FINEST), COARSEST), max(width, 1), max(height, 1))
