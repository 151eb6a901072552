"""What a rendered view looks like when some Gaussians vanish, at the cost of the tiles they touched.

The others project to where they were, so only lists of tiles that held a vanished one get shorter.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float32
from numpy import ndarray

from instdrive_core.rasterize.bin import TILE
from instdrive_core.rasterize.blend import blend
from instdrive_core.rasterize.render import Raster


@dataclass(frozen=True)
class Redrawn:
    """A view after something vanished."""

    image: Float32[ndarray, "h w c"]
    alpha: Float32[ndarray, "h w"]
    touched: Bool[ndarray, "h w"]
    """Pixels of the tiles that were drawn again; all others are as before, to the bit."""


def without_rows(raster: Raster, rows: Bool[ndarray, " n"]) -> Redrawn:
    """Draw a raster again without the given rows: bit for bit what `render` makes of the others.

    Args:
        raster: of `render`; the arrays it was made of must be unchanged.
        rows: True for what vanishes, one entry per Gaussian rendered.
    """
    context = raster.context
    tiles, projection = context.tiles, context.projection
    height, width, channels = raster.image.shape
    tile_of_pair = np.repeat(np.arange(tiles.rows * tiles.columns), np.diff(tiles.starts))
    gone = rows[projection.rows][tiles.splats]
    touched = np.zeros(tiles.rows * tiles.columns, bool)
    touched[tile_of_pair[gone]] = True
    kept = touched[tile_of_pair] & ~gone
    counts = np.bincount(tile_of_pair[kept], minlength=len(touched))
    starts = np.concatenate([np.zeros(1, np.int64), np.cumsum(counts)])
    shorter = replace(tiles, starts=starts, splats=tiles.splats[kept], spans=tiles.spans[kept])
    drawn = blend(context.records, shorter, channels, width, height, context.settings)
    pixels = touched.reshape(tiles.rows, tiles.columns).repeat(TILE, axis=0).repeat(TILE, axis=1)[:height, :width]
    return Redrawn(
        np.where(pixels[..., None], drawn.image, raster.image), np.where(pixels, drawn.alpha, raster.alpha), pixels
    )
