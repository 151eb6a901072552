"""Walk over the fragments of single pixels, nearest first, as `render` blends them, without drawing the frame."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from jaxtyping import Float, Int, Int64
from numpy import ndarray

from instdrive_core.rasterize.kernels.bin import TILE, TileLists, bin_splats
from instdrive_core.rasterize.kernels.fragment import FAST, FLOOR, compute_exponent, power_of_two
from instdrive_core.rasterize.kernels.layout import to_kernel_array
from instdrive_core.rasterize.kernels.project import Projection, project
from instdrive_core.rasterize.kernels.settings import RasterSettings
from instdrive_core.scene.camera import Camera

PIXELS_PER_TASK = 64
"""Pixels that one thread takes at a time; neighbours read the same splats."""


@dataclass(frozen=True)
class PixelLists:
    """P pixels, tile by tile, and the splats of their tiles."""

    projection: Projection
    tiles: TileLists
    pixels: Int64[ndarray, " p"]
    """Row-major flat indices, in the order of the tiles."""
    order: Int64[ndarray, " p"]
    """Place of each among the pixels asked for."""
    tile_of_pixel: Int64[ndarray, " p"]
    width: int
    """Width of the image in pixels."""

    def to_arguments(self) -> tuple[tuple[ndarray, ...], tuple[ndarray, ...], tuple[ndarray, ...], int]:
        """Arrays in the order in which kernels take them: splats, lists of tiles, pixels, and the image's width."""
        tiles = self.tiles
        return (
            (self.projection.splats, self.projection.rows),
            (tiles.starts, tiles.splats, tiles.spans),
            (self.pixels, self.order, self.tile_of_pixel),
            self.width,
        )


def list_pixels(
    means: Float[ndarray, "n 3"],
    quats: Float[ndarray, "n 4"],
    log_scales: Float[ndarray, "n 3"],
    opacities: Float[ndarray, " n"],
    camera: Camera,
    pixels: Int[ndarray, " p"],
    settings: RasterSettings,
) -> PixelLists:
    """Project the Gaussians and list the splats that the given pixels (row-major, flat) have to be walked over.

    Raises:
        ValueError: a pixel is outside the image.
    """
    means, quats, log_scales, opacities = (to_kernel_array(array) for array in (means, quats, log_scales, opacities))
    return list_projected_pixels(project(means, quats, log_scales, opacities, camera, settings), camera, pixels)


def list_projected_pixels(projection: Projection, camera: Camera, pixels: Int[ndarray, " p"]) -> PixelLists:
    """List the splats that the given pixels (row-major, flat) of what was projected have to be walked over.

    Raises:
        ValueError: a pixel is outside the image.
    """
    pixels = np.ascontiguousarray(pixels, np.int64)
    if len(pixels) and not 0 <= pixels.min() <= pixels.max() < camera.width * camera.height:
        raise ValueError(f"pixels {pixels.min()} … {pixels.max()} leave the {camera.width} × {camera.height} image")
    tiles = bin_splats(projection, camera.width, camera.height)
    tile_of_pixel = pixels // camera.width // TILE * tiles.columns + pixels % camera.width // TILE
    order = np.argsort(tile_of_pixel, kind="stable")
    return PixelLists(projection, tiles, pixels[order], order, tile_of_pixel[order], camera.width)


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=FAST)
def locate_pixel(pixel, width):
    """Left and top edge of a pixel's tile, and column and line inside it."""
    column, line = pixel % width, pixel // width
    left, top = column // TILE * TILE, line // TILE * TILE
    return left, top, column - left, line - top


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=FAST)
def compute_alpha(splats, v, place, constants):
    """α′ of splat v at a pixel (`place` as `locate_pixel` gives it); 0 where it is too faint to be drawn."""
    left, top, column, line = place
    x, y, base, xx, xy, yy = compute_exponent(splats, v, np.float32(left), np.float32(top), constants[2])
    dx, dy = np.float32(column) - x, np.float32(line) - y
    exponent = base + yy * dy * dy + dx * (xy * dy + xx * dx)
    if exponent < FLOOR:
        return np.float32(0)
    alpha = power_of_two(exponent)
    return min(alpha, constants[3]) if alpha >= constants[2] else np.float32(0)


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=FAST)
def find_next_fragment(splats, pair_splats, spans, pair, stop, place, before, constants):
    """The next pair (tile, splat) from `pair` on that the pixel blends, and the light left behind it.

    `stop`, and `before` unchanged, where nothing more is blended: the list has ended, or the pixel is finished.
    """
    line = place[3]
    while pair < stop:
        if spans[pair, 0] <= line < spans[pair, 1]:
            alpha = compute_alpha(splats, pair_splats[pair], place, constants)
            if alpha > np.float32(0):
                after = before - before * alpha
                if after > constants[4]:
                    return pair, after
                return stop, before
        pair += 1
    return stop, before
