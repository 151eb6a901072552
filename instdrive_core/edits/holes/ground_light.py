"""In which light each cell of ground lies: holes are filled as if all ground lay in the sun, then shade is laid on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64
from numpy import ndarray
from scipy import ndimage

OTHER_LIGHT = 0.02
"""What it costs to copy from ground in the other light: it is not quite as it would be here."""
LEAST_LEFT = 0.3
"""Ground at the edges of shade is half lit, and is not copied as long as this share of the known ground is left."""
SOFTNESS = 0.7
"""Cells: standard deviation of the edge of shade."""


@dataclass(frozen=True)
class GroundLight:
    """The light on a grid of ground."""

    shaded: Float64[ndarray, "a b"]
    """Probability that a cell lies in the shade."""
    dimming: Float64[ndarray, "a b 3"]
    """Share of R, G and B that is left in the shade."""

    def compute_shares(self, hole: Bool[ndarray, "a b"], detail: int = 1) -> Float64[ndarray, "a b 3"]:
        """Share of R, G and B that is left everywhere; shade in the `hole` has soft edges. A grid that was made finer
        has `detail` cells for each of before along either axis."""
        soft = np.asarray(ndimage.gaussian_filter(self.shaded, SOFTNESS * detail, mode="nearest"))
        known = (self.shaded > 0.5).astype(np.float64)
        return self.dimming ** np.where(hole, soft, known)[..., None]

    def find_sources(self, known: Bool[ndarray, "a b"]) -> Bool[ndarray, "a b"]:
        """Those of the `known` cells that do not lie at an edge of shade."""
        dark = np.where(known, np.where(self.shaded > 0.5, 1, -1), 0)
        sources = known & ~((ndimage.maximum_filter(dark, 3) > 0) & (ndimage.minimum_filter(dark, 3) < 0))
        return sources if np.count_nonzero(sources) >= LEAST_LEFT * np.count_nonzero(known) else known

    def refine(self, factor: int) -> GroundLight:
        """Cut each cell into `factor` × `factor` cells in the same light."""
        shaded, dimming = (np.repeat(np.repeat(each, factor, 0), factor, 1) for each in (self.shaded, self.dimming))
        return GroundLight(shaded, dimming)

    def compute_costs(self) -> Float64[ndarray, "a b"]:
        """Whose squared difference is what it costs to copy from one cell to another."""
        return np.sqrt(OTHER_LIGHT) * self.shaded
