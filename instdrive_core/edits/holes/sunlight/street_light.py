"""The light on the ground of a stretch of street: who throws shade, and how dark it is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64
from numpy import ndarray
from scipy import ndimage

from instdrive_core.edits.holes.ground_grid import GroundGrid
from instdrive_core.edits.holes.ground_light import GroundLight
from instdrive_core.edits.holes.sunlight.standing_rows import StandingRows
from instdrive_core.edits.holes.sunlight.sun import GroundLights, Sun, find_sun, forecast_shade
from instdrive_core.edits.holes.sunlight.two_lights import TwoLights, fit_two_lights, measure_dimming

KERB = 0.05
"""Metres above the carriageway from which on ground is of another kind."""
LEAST_AGREEMENT = 0.5
"""Correlation of the shade that a sun throws with ground that is dark, from which on it is believed."""
LEAST_RATIO = 0.4
"""Logarithm of how much brighter ground in the sun must be."""
LEAST_DARK, LEAST_BRIGHT = 60, 60
"""Cells of either that there must be."""
CLEAR = 1.0
"""Logarithm of the odds from which on ground counts as dark or bright."""
TRUST = 0.5
"""Share of what the sun says about ground whose colour is known."""
AROUND = 5
"""Cells along and across whose median tells in which light a bright mark in the middle lies."""


@dataclass(frozen=True)
class StreetLight:
    """A sun, what keeps it away, and how bright ground is."""

    rows: StandingRows
    sun: Sun
    lights: TwoLights
    dimming: Float64[ndarray, "2 3"]
    """Share of R, G and B that is left in the shade, of carriageways and of what lies higher."""

    def light_ground(
        self,
        grid: GroundGrid,
        color: Float64[ndarray, "a b 3"],
        hole: Bool[ndarray, "a b"],
        height: Float64[ndarray, "a b"],
        standing: Bool[ndarray, " n"],
    ) -> GroundLight:
        """The light on another grid. What is known has a `color`; of the `hole` only the sun tells, of the points that
        are still `standing`. `height` is in metres above the carriageway."""
        raised = height > KERB
        own = self.rows.grid
        places = (grid.compute_centers(grid.list_cells()) - np.array(own.corner)) @ own.axes.T
        heights = np.where(raised, height, 0.0).ravel()
        before, after = (
            forecast_shade(self.rows, self.sun, places, heights, there).reshape(grid.shape)
            for there in (None, standing)
        )
        told = self.lights.tell_shade(color, raised)
        # A mark in the shade is as bright as ground in the sun; what is dark in the sun is better taken for shade.
        told = np.maximum(told, ndimage.median_filter(told, AROUND, mode="nearest"))
        odds = TRUST * np.log((before + 0.05) / (1.05 - before)) + told
        return GroundLight(np.where(hole, after, 1 / (1 + np.exp(-odds))), self.dimming[raised.astype(np.int64)])


def find_street_light(
    rows: StandingRows,
    places: Float64[ndarray, "k 2"],
    heights: Float64[ndarray, " k"],
    color: Float64[ndarray, "k 3"],
) -> StreetLight | None:
    """Find the sun by known ground: metres along and across on the rows' grid and above the carriageway, and its
    colours. None where no sun explains which ground is dark, as under clouds."""
    raised = heights > KERB
    lights = fit_two_lights(color, raised)
    if lights is None or lights.ratio < LEAST_RATIO:
        return None
    told = lights.tell_shade(color, raised)
    dark, bright = told > CLEAR, told < -CLEAR
    if np.count_nonzero(dark) < LEAST_DARK or np.count_nonzero(bright) < LEAST_BRIGHT:
        return None
    sun = find_sun(rows, GroundLights(places, heights, told))
    if (
        correlate(forecast_shade(rows, sun, places, heights)[dark | bright] > 0.5, dark[dark | bright])
        < LEAST_AGREEMENT
    ):
        return None
    return StreetLight(rows, sun, lights, measure_dimming(color, raised, told, lights))


def correlate(one: Bool[ndarray, " k"], other: Bool[ndarray, " k"]) -> float:
    """Correlation of two masks, -1 … 1; 0 where one of them is the same everywhere."""
    spread = float(one.std() * other.std())
    return float(((one & other).mean() - one.mean() * other.mean()) / spread) if spread else 0.0
