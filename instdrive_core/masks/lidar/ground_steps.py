"""Steps in the ground: how far it rises at once at each cell of a grid, and to which side.

Around each cell a plane is fitted to the heights, and one with a step through the cell's middle, in some directions.
The step's height is one coefficient of the larger fit, found from the smaller one (Frisch & Waugh, Econometrica 1(4),
1933): a slope, however steep, is none.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from numpy import ndarray
from scipy import signal

RADIUS = 1.0
"""Metres around a cell whose heights say whether it lies on a step."""
DIRECTIONS = 8
"""Across which steps are looked for, over half a turn."""
LEAST_CELLS = 5
"""Known cells on either side below which nothing is measured."""
DOUBT = 1.5
"""Standard errors by which a step counts as lower than it was measured."""
NOISE = 0.01
"""Metres by which heights vary at least: a few cells may fit by chance."""
TILE = 256
"""Cells along an edge of the parts in which the grid is gone through: much of the land around a drive is never seen."""
_RIDGE = np.diag([1e-6, 1e-3, 1e-3])
"""Keeps planes through cells of one line from tilting at will."""


@dataclass(frozen=True)
class GroundSteps:
    """The step at each cell: 0 where none is sure, NaN where too little is known around."""

    heights: Float64[ndarray, "x y"]
    """Metres, at least 0."""
    rises: Float64[ndarray, "x y 2"]
    """Vectors of that length along x and y, to the higher side."""


def measure_ground_steps(heights: Float64[ndarray, "x y"], cell: float) -> GroundSteps:
    """Measure the step at each cell.

    Args:
        heights: metres, NaN where nothing is known.
        cell: metres along an edge of a cell.
    """
    steps = GroundSteps(np.full(heights.shape, np.nan), np.full((*heights.shape, 2), np.nan))
    rim = int(np.ceil(RADIUS / cell))
    padded = np.pad(heights, rim, constant_values=np.nan)
    for row in range(0, heights.shape[0], TILE):
        for column in range(0, heights.shape[1], TILE):
            tile = slice(row, row + TILE), slice(column, column + TILE)
            part = padded[row : row + TILE + 2 * rim, column : column + TILE + 2 * rim]
            if np.isfinite(part).any():
                found = _measure_tile(part, cell, rim)
                inner = slice(rim, part.shape[0] - rim), slice(rim, part.shape[1] - rim)
                steps.heights[tile], steps.rises[tile] = found.heights[inner], found.rises[inner]
    return steps


def _measure_tile(heights: Float64[ndarray, "x y"], cell: float, reach: int) -> GroundSteps:
    x, y = np.meshgrid(*2 * [np.arange(-reach, reach + 1) * cell], indexing="ij")
    disc = (np.hypot(x, y) <= RADIUS + 1e-6).astype(float)
    is_known = np.isfinite(heights)
    known, values = is_known.astype(float), np.where(is_known, heights - np.nanmean(heights), 0)

    def total(field: ndarray, *weights: ndarray) -> ndarray:
        kernels = [(disc * weight)[::-1, ::-1] for weight in weights]
        return np.stack([signal.fftconvolve(field, kernel, mode="same") for kernel in kernels], axis=-1)

    plane = (np.ones_like(x), x, y)
    moments = total(known, *(one * other for one in plane for other in plane)).reshape(*heights.shape, 3, 3)
    inverse = np.linalg.inv(moments + _RIDGE)
    shown = total(values, *plane)
    left_over = total(values**2, disc)[..., 0] - _multiply(shown, inverse, shown)
    steps = GroundSteps(np.full(heights.shape, np.nan), np.full((*heights.shape, 2), np.nan))
    for angle in np.pi * np.arange(DIRECTIONS) / DIRECTIONS:
        across = np.array([np.cos(angle), np.sin(angle)])
        side = np.sign(np.round(x * across[0] + y * across[1], 6)) / 2
        sides = total(known, *(side * one for one in plane))
        beside = total(known, np.abs(side))[..., 0]
        explained = np.maximum(beside / 2 - _multiply(sides, inverse, sides), 1e-3)
        shared = total(values, side)[..., 0] - _multiply(sides, inverse, shown)
        step = shared / explained
        spread = np.sqrt(np.maximum(left_over - step * shared, 0) / np.maximum(moments[..., 0, 0] - 4, 1))
        sure = np.maximum(np.abs(step) - DOUBT * np.maximum(spread, NOISE) / np.sqrt(explained), 0)
        better = (beside - np.abs(sides[..., 0]) > LEAST_CELLS - 0.5) & ~(sure <= steps.heights)
        steps.heights[better] = sure[better]
        steps.rises[better] = (np.sign(step) * sure)[better][:, None] * across
    return steps


def _multiply(
    left: Float64[ndarray, "x y 3"], matrices: Float64[ndarray, "x y 3 3"], right: Float64[ndarray, "x y 3"]
) -> Float64[ndarray, "x y"]:
    return np.einsum("xyi,xyij,xyj->xy", left, matrices, right, optimize=True)
