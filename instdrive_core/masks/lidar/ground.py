"""The ground under a drive: a height per cell of a horizontal grid, found from below the points.

A progressive morphological filter (Zhang et al., IEEE TGRS 41(4), 2003): what stands higher above an opening of the
lowest heights than a slope of `SLOPE` over the opening's window allows stands on the ground and is none of it. Of what
is left, the ground is what hangs together (`ground_growth`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64
from numpy import ndarray
from scipy import ndimage

from instdrive_core.masks.lidar.ground_growth import drape_surface, select_connected

CELL = 0.5
"""Metres along an edge of a cell."""
WINDOWS = (1.5, 3.0, 6.0, 12.0, 24.0)
"""Metres along an edge of the openings' windows: the last is wider than a bus is long."""
SLOPE = 0.06
STEP = 0.12
"""Metres that ground may stand above an opening at any window: curbs."""
NOISE = 4
"""Points of a cell that may lie below the ground: reflections from wet or glossy surfaces."""
PIT_BLOCK, PIT_SHARE, PIT_DEPTH = 4, 35, 0.3
"""Cells along an edge of a block, percentile of the blocks around, and metres below it: deeper lie only mirror images
in paint and wet ground."""
SMOOTHING = 1.0
"""Cells; standard deviation of the last smoothing."""
MARGIN, MARGIN_PER_METRE = 0.13, 0.003
"""Height up to which a point is ground, right at the sensor and per metre of distance."""


@dataclass(frozen=True)
class GroundSurface:
    """Heights of the ground on a grid."""

    corner: Float64[ndarray, "2"]
    """x and y of the first cell's centre."""
    heights: Float32[ndarray, "x y"]
    """z of the ground in each cell, known or guessed from what lies around."""

    def compute_heights_above(self, points: Float32[ndarray, "n 3"]) -> Float32[ndarray, " n"]:
        """Compute metres by which points lie above the ground, bilinear; outside of the grid as at its rim."""
        places = ((points[:, :2] - self.corner) / CELL).T
        heights = ndimage.map_coordinates(self.heights, places, order=1, mode="nearest")
        return (points[:, 2] - heights).astype(np.float32)


def find_ground(points: Float32[ndarray, "n 3"]) -> GroundSurface:
    """Find the ground under points in a world whose z axis points up. Raises ValueError where there are no points."""
    if not len(points):
        raise ValueError("no points to find the ground under")
    corner = np.floor(points[:, :2].min(axis=0).astype(float) / CELL) * CELL
    cells = np.rint((points[:, :2] - corner) / CELL).astype(np.int64)
    shape = tuple((cells.max(axis=0) + 1).tolist())
    lowest = _find_lowest(cells[:, 0] * shape[1] + cells[:, 1], points[:, 2], shape[0] * shape[1]).reshape(shape)
    lowest[lowest < _find_low_surroundings(lowest) - PIT_DEPTH] = np.nan
    ground = select_connected(lowest, _select_ground_cells(lowest), CELL)
    smooth = _smooth(np.where(ground, lowest, np.nan), SMOOTHING)
    return GroundSurface(corner, smooth.astype(np.float32))


def is_ground(above: Float32[ndarray, " n"], distance: Float32[ndarray, " n"]) -> Bool[ndarray, " n"]:
    """Whether points belong to the ground, by their height above it (metres) and their distance from the sensor."""
    return above < MARGIN + MARGIN_PER_METRE * distance


def _find_lowest(cells: Int64[ndarray, " n"], z: Float32[ndarray, " n"], count: int) -> Float64[ndarray, " c"]:
    """Find a low height of each cell that a few points below do not disturb; NaN where no point lies."""
    order = np.lexsort((z, cells))
    ordered = cells[order]
    starts = np.flatnonzero(np.diff(ordered, prepend=-1))
    sizes = np.diff(starts, append=len(ordered))
    lowest = np.full(count, np.nan)
    lowest[ordered[starts]] = z[order][starts + np.minimum(NOISE, sizes // 4)]
    return lowest


def _find_low_surroundings(lowest: Float64[ndarray, "x y"]) -> Float64[ndarray, "x y"]:
    """Find what is low in the wider surroundings of each cell."""
    padding = [(0, -size % PIT_BLOCK) for size in lowest.shape]
    padded = np.pad(lowest, padding, constant_values=np.nan)
    rows, columns = (size // PIT_BLOCK for size in padded.shape)
    blocks = padded.reshape(rows, PIT_BLOCK, columns, PIT_BLOCK).transpose(0, 2, 1, 3).reshape(rows, columns, -1)
    blocks = np.sort(blocks, axis=2)  # unknown cells come last
    counts = np.isfinite(blocks).sum(axis=2)
    middle = np.take_along_axis(blocks, np.maximum(counts - 1, 0)[..., None] // 2, axis=2)[..., 0]
    low = ndimage.percentile_filter(_fill_from_nearest(middle), PIT_SHARE, 5, mode="nearest")
    places = np.indices(lowest.shape) / PIT_BLOCK - 0.5 + 0.5 / PIT_BLOCK
    return ndimage.map_coordinates(low, places, order=1, mode="nearest")


def _fill_from_nearest(heights: Float64[ndarray, "x y"]) -> Float64[ndarray, "x y"]:
    """Fill unknown heights with the nearest known."""
    nearest = ndimage.distance_transform_edt(~np.isfinite(heights), return_distances=False, return_indices=True)
    return heights[tuple(np.asarray(nearest))]


def _select_ground_cells(lowest: Float64[ndarray, "x y"]) -> Bool[ndarray, "x y"]:
    """Select cells whose lowest points are ground."""
    known = np.isfinite(lowest)
    surface = _fill_from_nearest(lowest)
    ground = known.copy()
    for window in WINDOWS:
        size = 2 * round(window / CELL / 2) + 1
        opened = ndimage.grey_opening(surface, (size, size), mode="nearest")
        ground &= ~known | (surface - opened < STEP + SLOPE * window)
        surface = np.minimum(surface, opened + STEP + SLOPE * window)
    return ground


def _smooth(heights: Float64[ndarray, "x y"], sigma: float) -> Float64[ndarray, "x y"]:
    """Smooth the known heights by a Gaussian mean; where none is near, the surface is draped over them."""
    known = np.isfinite(heights)
    if not known.any():
        return np.zeros_like(heights)
    weights = ndimage.gaussian_filter(known.astype(float), sigma)
    sums = ndimage.gaussian_filter(np.where(known, heights, 0), sigma)
    return np.where(weights > 1e-3, sums / np.maximum(weights, 1e-12), drape_surface(heights))
