"""Front-to-back blending of the binned splats, tile by tile.

One flat float32 array per tile holds everything that is per pixel, in rows of 256: all offsets between rows are
known, so the compiler vectorises the pixel loops without checking for overlap. Loop bounds are uint64 because
signed indices would be checked for wrap-around.
"""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from instdrive_core.rasterize.bin import PIXELS, TILE, TileLists
from instdrive_core.rasterize.fragment import FAST, FLOOR, exponent_of, power_of_two
from instdrive_core.rasterize.project import DEPTH, Projection
from instdrive_core.rasterize.settings import RasterSettings

TILES_PER_TASK = 8
"""Tiles are dealt to threads in tasks of this size, as threads become free."""
BATCH = 16
"""Splats staged at once; after each batch a finished tile is left."""

STRIDE = np.uint64(PIXELS + TILE)  # rows one line apart, so that they do not fall on the same cache sets
_TRANSMITTANCE, _WEIGHT, _X, _Y, _DEPTH, _CHANNELS = (STRIDE * np.uint64(row) for row in range(6))


def blend(
    projection: Projection,
    tiles: TileLists,
    channels: Float32[ndarray, "n c"],
    width: int,
    height: int,
    settings: RasterSettings,
) -> tuple[Float32[ndarray, "h w c"], Float32[ndarray, "h w"], Float32[ndarray, "h w"]]:
    """Image Σ w·channels, depth Σ w·z and alpha Σ w."""
    image = np.empty((height, width, channels.shape[1]), np.float32)
    depth, alpha = np.empty((height, width), np.float32), np.empty((height, width), np.float32)
    with numba.parallel_chunksize(TILES_PER_TASK):
        _blend(
            projection.splats,
            projection.rows,
            channels,
            tiles.starts,
            tiles.splats,
            tiles.spans,
            tiles.columns,
            settings.as_row(),
            image,
            depth,
            alpha,
        )
    return image, depth, alpha


@numba.njit(cache=True, error_model="numpy")
def open_tile(scratch, transmittance, x, y, width, height):
    """Nothing blended yet; pixels outside the image, `width` and `height` from the tile's corner, are finished."""
    for q in range(np.uint64(PIXELS)):
        column, row = q % np.uint64(TILE), q // np.uint64(TILE)
        scratch[x + q], scratch[y + q] = column, row
        scratch[transmittance + q] = 1 if np.int64(column) < width and np.int64(row) < height else -1


@numba.njit(cache=True, error_model="numpy", fastmath=FAST)
def any_alive(scratch, transmittance):
    """Whether a pixel of the tile still lets light through; finished ones carry a negative transmittance."""
    alive = np.int32(0)
    for q in range(np.uint64(PIXELS)):
        alive += np.int32(scratch[transmittance + q] > np.float32(0))
    return alive > 0


@numba.njit(cache=True, error_model="numpy", fastmath=FAST)
def stage(staged, splats, rows, channels, pair_splats, start, stop, left, top, min_alpha):
    """Copy what a batch of splats needs: its cache misses overlap here, not where each splat waits for the last.

    A staged splat is the six numbers of `exponent_of`, its depth and its channels.
    """
    for pair in range(start, stop):
        i, v = pair - start, np.uint64(pair_splats[pair])
        x, y, base, xx, xy, yy = exponent_of(splats, v, left, top, min_alpha)
        staged[i, 0], staged[i, 1], staged[i, 2] = x, y, base
        staged[i, 3], staged[i, 4], staged[i, 5] = xx, xy, yy
        staged[i, 6] = splats[v, DEPTH]
        row = np.uint64(rows[v])
        for channel in range(np.uint64(channels.shape[1])):
            staged[i, np.uint64(7) + channel] = channels[row, channel]


@numba.njit(cache=True, error_model="numpy", fastmath=FAST)
def _blend_tile(scratch, staged, splats, rows, channels, pair_splats, spans, start, stop, left, top, constants):
    min_alpha, max_alpha, min_transmittance = constants[2], constants[3], constants[4]
    for batch in range(start, stop, np.uint64(BATCH)):
        end = min(batch + np.uint64(BATCH), stop)
        stage(staged, splats, rows, channels, pair_splats, batch, end, left, top, min_alpha)
        for i in range(end - batch):
            x, y, base = staged[i, 0], staged[i, 1], staged[i, 2]
            xx, xy, yy = staged[i, 3], staged[i, 4], staged[i, 5]
            first = np.uint64(spans[batch + i, 0]) * np.uint64(TILE)
            last = np.uint64(spans[batch + i, 1]) * np.uint64(TILE)
            for q in range(first, last):
                dx, dy = scratch[_X + q] - x, scratch[_Y + q] - y
                alpha = power_of_two(max(base + yy * dy * dy + dx * (xy * dy + xx * dx), FLOOR))
                alpha = min(alpha, max_alpha) if alpha >= min_alpha else np.float32(0)
                before = scratch[_TRANSMITTANCE + q]
                after = before - before * alpha
                goes_on = after > min_transmittance  # never true again once the sign is negative
                scratch[_WEIGHT + q] = before - after if goes_on else np.float32(0)
                scratch[_TRANSMITTANCE + q] = after if goes_on else -abs(before)
            for channel in range(np.uint64(channels.shape[1]) + np.uint64(1)):
                value, place = staged[i, np.uint64(6) + channel], _DEPTH + channel * STRIDE
                for q in range(first, last):
                    scratch[place + q] += scratch[_WEIGHT + q] * value
        if not any_alive(scratch, _TRANSMITTANCE):
            break


@numba.njit(cache=True, parallel=True, error_model="numpy", fastmath=FAST)
def _blend(splats, rows, channels, starts, pair_splats, spans, columns, constants, image, depth, alpha):
    height, width, count = image.shape
    for tile in numba.prange(len(starts) - 1):
        scratch = np.zeros(np.int64(_CHANNELS) + count * np.int64(STRIDE), np.float32)
        left, top = tile % columns * TILE, tile // columns * TILE
        open_tile(scratch, _TRANSMITTANCE, _X, _Y, width - left, height - top)
        staged = np.empty((BATCH, 7 + count), np.float32)
        _blend_tile(
            scratch,
            staged,
            splats,
            rows,
            channels,
            pair_splats,
            spans,
            np.uint64(starts[tile]),
            np.uint64(starts[tile + 1]),
            np.float32(left),
            np.float32(top),
            constants,
        )
        for y in range(top, min(top + TILE, height)):
            for x in range(left, min(left + TILE, width)):
                q = (y - top) * TILE + x - left
                alpha[y, x] = np.float32(1) - abs(scratch[np.int64(_TRANSMITTANCE) + q])
                depth[y, x] = scratch[np.int64(_DEPTH) + q]
                for channel in range(count):
                    image[y, x, channel] = scratch[np.int64(_CHANNELS) + channel * np.int64(STRIDE) + q]
