"""How high splats lie above the ground, in scenes that say nothing of what is ground.

The ground is the dense lower surface: the lowest layer of each cell seen from above, without what stands on it. What
stands there is taken away by openings with discs of growing size, and told from hills by its steep sides (SMRF: Pingel,
Clarke and McBride 2013, "An improved simple morphological filter for the terrain classification of airborne LIDAR
data").
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float64, Int64
from numpy import ndarray
from scipy import ndimage

_OUTLIERS = 0.002
"""Share of the splats at each end of x and y that are too far out to have ground below them."""
_MOST_CELLS = 4_000_000


@dataclass(frozen=True)
class GroundConfig:
    """What is ground; lengths are in units of the scene's size, metres on a street."""

    cell: float = 0.5
    lowest_share: float = 0.1
    """Share of a cell's splats that may lie below its ground."""
    widest: int = 12
    """Radius in cells of the largest thing that stands on the ground and hides all of it; wider ones are hills."""
    slope: float = 0.15
    """What rises more than this from a cell to the next is no ground."""
    smoothing: float = 1.0
    """Standard deviation, in cells, of the average that the surface is."""


def measure_heights_above_ground(
    means: Float[ndarray, "n 3"], solid: Bool[ndarray, " n"], unit: float, config: GroundConfig = GroundConfig()
) -> Float64[ndarray, " n"]:
    """Measure how high each splat lies above the ground, in the scene's lengths; NaN where nothing is known of it.

    Args:
        means: z is up.
        solid: which of them are opaque and small enough to tell where a surface is.
        unit: length of the scene that is a metre on a street.
        config: sizes in units.
    """
    heights, cell = np.full(len(means), np.nan), config.cell * unit
    usable = solid & np.isfinite(means).all(axis=1)
    if not usable.any():
        return heights
    places = means[:, :2].astype(np.float64)
    low, high = np.quantile(places[usable], [_OUTLIERS, 1 - _OUTLIERS], axis=0)
    cell = max(cell, float(np.sqrt(np.prod(high - low) / _MOST_CELLS)))
    shape = np.floor((high - low) / cell).astype(np.int64) + 1
    with np.errstate(invalid="ignore"):
        cells = np.floor((places - low) / cell)
        inside = ((cells >= 0) & (cells < shape)).all(axis=1)
    flat = cells[inside].astype(np.int64) @ np.array([shape[1], 1])
    lowest = _find_lowest_layer(flat, means[inside, 2], usable[inside], shape, config.lowest_share)
    surface = _take_away_objects(lowest, cell, config)
    heights[inside] = means[inside, 2] - surface.ravel()[flat]
    return heights


def _find_lowest_layer(
    flat: Int64[ndarray, " k"],
    heights: Float[ndarray, " k"],
    usable: Bool[ndarray, " k"],
    shape: Int64[ndarray, "2"],
    share: float,
) -> Float64[ndarray, "a b"]:
    """Low quantile of the heights in each cell; NaN where a cell is empty."""
    layer, flat, heights = np.full(int(np.prod(shape)), np.nan), flat[usable], heights[usable]
    order = np.lexsort((heights, flat))
    flat, heights = flat[order], heights[order]
    starts = np.flatnonzero(np.r_[True, flat[1:] != flat[:-1]]) if len(flat) else np.zeros(0, np.int64)
    counts = np.diff(np.r_[starts, len(flat)])
    layer[flat[starts]] = heights[starts + (share * counts).astype(np.int64)]
    return layer.reshape(tuple(shape))


def _take_away_objects(lowest: Float64[ndarray, "a b"], cell: float, config: GroundConfig) -> Float64[ndarray, "a b"]:
    """Surface of the ground: what stands on it is bridged, and pits of one cell are floaters below it."""
    surface = np.asarray(ndimage.grey_closing(_fill_from_near(lowest), 3))
    opened, standing = surface, np.zeros(surface.shape, bool)
    for radius in range(1, config.widest + 1):
        x, y = np.mgrid[-radius : radius + 1, -radius : radius + 1]
        lower = np.asarray(ndimage.grey_opening(opened, footprint=np.hypot(x, y) <= radius))
        standing |= opened - lower > config.slope * radius * cell
        opened = lower
    bare = np.where(np.isnan(lowest) | standing, np.nan, surface)
    if np.isnan(bare).all():
        bare = opened
    return np.asarray(ndimage.gaussian_filter(_fill_from_near(bare), config.smoothing))


def _fill_from_near(values: Float64[ndarray, "a b"]) -> Float64[ndarray, "a b"]:
    nearest = ndimage.distance_transform_edt(np.isnan(values), return_distances=False, return_indices=True)
    return values[tuple(np.asarray(nearest))]
