"""Top contributors: the Gaussian with the largest weight in each pixel, mostly found before the end of its list."""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float, Int, Int64
from numpy import ndarray

from instdrive_core.rasterize.kernels.fragment import FAST
from instdrive_core.rasterize.kernels.pixel_walk import (
    PIXELS_PER_TASK,
    find_next_fragment,
    list_pixels,
    locate_pixel,
)
from instdrive_core.rasterize.kernels.settings import DEFAULT_SETTINGS, RasterSettings
from instdrive_core.scene.camera import Camera


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
    """Find the Gaussian with the largest blending weight in each of the given pixels (row-major, flat).

    Ties go to the nearer one; -1 where all of them together hide less than `min_alpha`. The weights are those of
    `compute_blend_weights`.

    Raises:
        ValueError: a pixel is outside the image.
    """
    lists = list_pixels(means, quats, log_scales, opacities, camera, pixels, settings)
    top = np.empty(len(pixels), np.int64)
    with numba.parallel_chunksize(PIXELS_PER_TASK):
        _walk_pixels(*lists.to_arguments(), np.float32(min_alpha), settings.to_row(), top)
    return top


@numba.njit(cache=True, parallel=True, error_model="numpy", fastmath=FAST)
def _walk_pixels(projected, lists, asked, width, needed_alpha, constants, top):
    splats, splat_rows = projected
    starts, pair_splats, spans = lists
    pixels, order, tile_of_pixel = asked
    for number in numba.prange(len(pixels)):
        place, tile = locate_pixel(pixels[number], width), tile_of_pixel[number]
        before, largest, found, stop = np.float32(1), np.float32(0), -1, starts[tile + 1]
        pair, after = find_next_fragment(splats, pair_splats, spans, starts[tile], stop, place, before, constants)
        while pair < stop:
            if before - after > largest:
                largest, found = before - after, splat_rows[pair_splats[pair]]
            before = after
            # What is left over bounds all weights that follow.
            if before <= largest and np.float32(1) - before >= needed_alpha:
                break
            pair, after = find_next_fragment(splats, pair_splats, spans, pair + 1, stop, place, before, constants)
        top[order[number]] = found if np.float32(1) - before >= needed_alpha else -1
