"""The constants of splatting, as 3DGS and gsplat's classic mode have them."""

from __future__ import annotations

from dataclasses import astuple, dataclass, replace

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from instdrive_core.scene.scene import Scene


@dataclass(frozen=True)
class RasterSettings:
    """Constants of splatting."""

    near: float = 0.1
    """Splats whose centre is nearer than this (metres along the viewing axis) are not drawn."""
    low_pass: float = 0.3
    """Added to the diagonal of every 2D covariance (pixel²): no splat is thinner than about a pixel."""
    min_alpha: float = 1 / 255
    """Fragments fainter than this are skipped; at least 1/256, which the exponential's range is made for."""
    max_alpha: float = 0.999
    """Fragments are never more opaque than this."""
    min_transmittance: float = 1e-4
    """A pixel is finished before the fragment that would leave no more than this of the light behind it."""
    antialiased: bool = False
    """Whether a splat's opacity falls as the low-pass widens it, so that what it hides in all stays the same."""

    def __post_init__(self) -> None:
        if not 1 / 256 <= self.min_alpha < self.max_alpha < 1:
            raise ValueError(
                f"min_alpha {self.min_alpha} and max_alpha {self.max_alpha} do not fit 1/256 ≤ min < max < 1"
            )

    def fit_smaller(self, factor: int) -> RasterSettings:
        """Fit a picture `factor` times smaller, each of whose pixels shall be the mean of a square of the whole one's.

        Splats get the low-pass that they have in the whole picture, and the variance of such a square: not that of a
        pixel of the smaller picture, with which small splats would cover far too much.
        """
        return replace(self, low_pass=(self.low_pass + (factor**2 - 1) / 12) / factor**2)

    def to_row(self) -> Float32[ndarray, " 6"]:
        """Write the constants in the order above, as the kernels take them."""
        return np.array(astuple(self), np.float32)


DEFAULT_SETTINGS = RasterSettings()
"""Constants of 3DGS and gsplat."""


def choose_raster_settings(scene: Scene) -> RasterSettings:
    """Choose the constants that a scene was trained to be drawn with."""
    return RasterSettings(antialiased=True) if scene.antialiased else DEFAULT_SETTINGS
