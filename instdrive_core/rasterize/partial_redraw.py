"""Redraw a rendered view without some of its Gaussians, at the cost of the tiles that they touched.

The others project to where they were, so only lists of tiles that held a vanished one get shorter.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float32, Int
from numpy import ndarray

from instdrive_core.rasterize.kernels.bin import TILE
from instdrive_core.rasterize.kernels.blend import blend
from instdrive_core.rasterize.render import Raster


@dataclass(frozen=True)
class RedrawnWindow:
    """The part of a view that changed when something vanished."""

    window: tuple[slice, slice]
    """Rows and columns of the image. Outside everything is as before, to the bit."""
    image: Float32[ndarray, "wh ww c"]
    """Image inside the window."""
    alpha: Float32[ndarray, "wh ww"]


def redraw_without_rows(raster: Raster, rows: Bool[ndarray, " n"]) -> RedrawnWindow:
    """Draw a raster again without the given rows: bit for bit what `render` makes of the others.

    Args:
        raster: of `render`; the arrays it was made of must be unchanged.
        rows: True for what vanishes, one entry per Gaussian rendered.
    """
    context, tiles = raster.context, raster.context.tiles
    height, width, channels = raster.image.shape
    gone = np.flatnonzero(rows[context.projection.rows][tiles.splats])
    touched = np.zeros(tiles.rows * tiles.columns, bool)
    touched[np.searchsorted(tiles.starts, gone, side="right") - 1] = True
    kept = np.repeat(touched, np.diff(tiles.starts))
    kept[gone] = False
    kept_before = np.concatenate([np.zeros(1, np.int64), np.cumsum(kept)])
    shorter = replace(tiles, starts=kept_before[tiles.starts], splats=tiles.splats[kept], spans=tiles.spans[kept])
    drawn = blend(context.records, shorter, channels, width, height, context.settings)
    grid = touched.reshape(tiles.rows, tiles.columns)
    window = _window(np.flatnonzero(grid.any(axis=1))), _window(np.flatnonzero(grid.any(axis=0)))
    pixels = grid.repeat(TILE, axis=0).repeat(TILE, axis=1)[:height, :width][window]
    image = np.where(pixels[..., None], drawn.image[window], raster.image[window])
    return RedrawnWindow(window, image, np.where(pixels, drawn.alpha[window], raster.alpha[window]))


def _window(touched: Int[ndarray, " k"]) -> slice:
    """Pixels from the first to the last touched tile along one axis."""
    return slice(TILE * int(touched[0]), TILE * (int(touched[-1]) + 1)) if len(touched) else slice(0, 0)
