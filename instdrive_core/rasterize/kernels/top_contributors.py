"""Which Gaussian contributes most to each pixel: one number per pixel, found without walking to the end of its list."""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float, Int, Int64
from numpy import ndarray

from instdrive_core.rasterize.kernels.bin import TILE, bin_splats
from instdrive_core.rasterize.kernels.fragment import FAST, FLOOR, compute_exponent, power_of_two
from instdrive_core.rasterize.kernels.layout import to_kernel_array
from instdrive_core.rasterize.kernels.project import project
from instdrive_core.rasterize.kernels.settings import DEFAULT_SETTINGS, RasterSettings
from instdrive_core.scene.camera import Camera

_PIXELS_PER_TASK = 64


def find_top_contributors(
    means: Float[ndarray, "n 3"],
    quats: Float[ndarray, "n 4"],
    log_scales: Float[ndarray, "n 3"],
    opacities: Float[ndarray, " n"],
    camera: Camera,
    pixels: Int[ndarray, " p"],
    min_alpha: float,
    settings: RasterSettings = DEFAULT_SETTINGS,
) -> Int64[ndarray, " p"]:
    """The Gaussian with the largest blending weight in each of the given pixels (row-major, flat), ties to the nearer
    one; -1 where all of them together hide less than `min_alpha`.

    The weights are those of `blend_weights`.

    Raises:
        ValueError: a pixel is outside the image.
    """
    pixels = np.ascontiguousarray(pixels, np.int64)
    if len(pixels) and not 0 <= pixels.min() <= pixels.max() < camera.width * camera.height:
        raise ValueError(f"pixels {pixels.min()} … {pixels.max()} leave the {camera.width} × {camera.height} image")
    means, quats, log_scales, opacities = (to_kernel_array(array) for array in (means, quats, log_scales, opacities))
    projection = project(means, quats, log_scales, opacities, camera, settings)
    tiles = bin_splats(projection, camera.width, camera.height)
    tile_of_pixel = pixels // camera.width // TILE * tiles.columns + pixels % camera.width // TILE
    order = np.argsort(tile_of_pixel, kind="stable")  # neighbours in one thread: they read the same splats
    top = np.empty(len(pixels), np.int64)
    with numba.parallel_chunksize(_PIXELS_PER_TASK):
        _walk_pixels(
            (projection.splats, projection.rows),
            (tiles.starts, tiles.splats, tiles.spans),
            (pixels[order], order, tile_of_pixel[order]),
            camera.width,
            np.float32(min_alpha),
            settings.to_row(),
            top,
        )
    return top


@numba.njit(cache=True, parallel=True, error_model="numpy", fastmath=FAST)
def _walk_pixels(projected, lists, asked, width, needed_alpha, constants, top):
    splats, splat_rows = projected
    starts, pair_splats, spans = lists
    pixels, order, tile_of_pixel = asked
    min_alpha, max_alpha, min_transmittance = constants[2], constants[3], constants[4]
    for place in numba.prange(len(pixels)):
        column, line = pixels[place] % width, pixels[place] // width
        left, above = column // TILE * TILE, line // TILE * TILE
        column, line = column - left, line - above
        tile = tile_of_pixel[place]
        before, largest, found = np.float32(1), np.float32(0), -1
        for pair in range(starts[tile], starts[tile + 1]):
            # What is left over bounds all weights that follow.
            if before <= largest and np.float32(1) - before >= needed_alpha:
                break
            if line < spans[pair, 0] or line >= spans[pair, 1]:
                continue
            v = pair_splats[pair]
            x, y, base, xx, xy, yy = compute_exponent(splats, v, np.float32(left), np.float32(above), min_alpha)
            dx, dy = np.float32(column) - x, np.float32(line) - y
            exponent = base + yy * dy * dy + dx * (xy * dy + xx * dx)
            if exponent < FLOOR:
                continue
            alpha = power_of_two(exponent)
            if alpha < min_alpha:
                continue
            after = before - before * min(alpha, max_alpha)
            if not after > min_transmittance:
                break
            if before - after > largest:
                largest, found = before - after, splat_rows[v]
            before = after
        top[order[place]] = found if np.float32(1) - before >= needed_alpha else -1
