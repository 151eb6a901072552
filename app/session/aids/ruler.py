"""The ruler: two points of the scene, and how far they are apart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.wording import phrase


@dataclass
class Ruler:
    """Keeps the points that were clicked: none, one or two."""

    points: tuple[Float64[ndarray, "3"], ...] = ()
    """Metres, in the world."""

    def add(self, place: Float64[ndarray, "3"]) -> None:
        """Set the next point; a third one begins a new measurement."""
        self.points = (place,) if len(self.points) == 2 else (*self.points, place)

    def clear(self) -> None:
        """Take all points away."""
        self.points = ()

    def describe(self) -> str:
        """Say how far the points are apart, along the ground and in height; empty before there are two."""
        if len(self.points) < 2:
            return ""
        shift = self.points[1] - self.points[0]
        level = float(np.hypot(shift[0], shift[1]))
        return phrase(
            "{length:.2f} m   (level {level:.2f} m, height {height:+.2f} m)",
            length=float(np.linalg.norm(shift)),
            level=level,
            height=float(shift[2]),
        )
