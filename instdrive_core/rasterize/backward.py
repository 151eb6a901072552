"""Gradient of the blending: a second walk through each tile, front to back, that recomputes the forward pass.

With g the pixel's gradient contracted with a splat's channels, and S what the splats behind it add to Σ w·g, a
fragment's dL/dα′ is T·g - S / (1 - α′). S starts as the whole pixel, known from the forward pass, and shrinks as the
walk goes on: nothing is stored per fragment. Sums over a tile's pixels go to one row per pair (tile, splat);
`project_backward` adds each splat's rows in tile order, so the result does not depend on which thread took which tile.
"""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from instdrive_core.rasterize.bin import PIXELS, TILE, TileLists
from instdrive_core.rasterize.blend import BATCH, STRIDE, TILES_PER_TASK, any_alive, open_tile
from instdrive_core.rasterize.fragment import FAST, FLOOR, exponent_of, power_of_two
from instdrive_core.rasterize.project import CONIC_XX, CONIC_XY, CONIC_YY, DEPTH, Projection
from instdrive_core.rasterize.settings import RasterSettings

# Columns of a pair's row: sums over the pixels of d = dL/dlog α′, with (x, y) = pixel - mean; then depth and channels.
SUM_D, SUM_X, SUM_Y, SUM_XX, SUM_XY, SUM_YY, SUM_ABS_X, SUM_ABS_Y, SUM_DEPTH, SUM_CHANNELS = range(10)

_REORDERED = FAST | {"reassoc"}
"""Sums over pixels vectorise only where the compiler may choose their order; it is the same in every run."""
_BLOCK = np.uint64(4)
"""Channels are handled four at a time, in two groups padded to whole blocks: depth and geometry channels, the rest."""
_STAGED = 9
"""Numbers per staged splat in front of its depth and geometry channels."""
_ROWS = tuple(STRIDE * np.uint64(row) for row in range(8))
_TRANSMITTANCE, _WEIGHT, _X, _Y, _BEHIND, _GRAD_ALPHA, _GRAD_REST, _GRADS = _ROWS

Images = tuple[Float32[ndarray, "h w c"], Float32[ndarray, "h w"], Float32[ndarray, "h w"]]


def blend_backward(
    projection: Projection,
    tiles: TileLists,
    channels: Float32[ndarray, "n c"],
    outputs: Images,
    grads: Images,
    geometry_channels: int,
    settings: RasterSettings,
) -> Float32[ndarray, "m 9+c"]:
    """Sums of every pair (tile, splat), in the order of the tile lists; columns as named above.

    Args:
        outputs: image, depth and alpha of the forward pass.
        grads: the loss's gradients with respect to them.
        geometry_channels: how many of the first channels count in d.
    """
    pair_sums = np.empty((len(tiles.splats), SUM_CHANNELS + channels.shape[1]), np.float32)
    with numba.parallel_chunksize(TILES_PER_TASK):
        _blend_backward(
            (projection.splats, projection.rows, channels),
            (tiles.starts, tiles.splats, tiles.spans),
            tiles.columns,
            settings.as_row(),
            outputs,
            grads,
            geometry_channels,
            pair_sums,
        )
    return pair_sums


@numba.njit(cache=True, error_model="numpy", fastmath=FAST)
def _stage(staged, splats, rows, channels, geometry, pair_splats, start, stop, left, top, min_alpha):
    """Copy what a batch of splats needs: its cache misses overlap here, not where each splat waits for the last."""
    for pair in range(start, stop):
        i, v = pair - start, np.uint64(pair_splats[pair])
        x, y, base, xx, xy, yy = exponent_of(splats, v, left, top, min_alpha)
        staged[i, 0], staged[i, 1], staged[i, 2] = x, y, base
        staged[i, 3], staged[i, 4], staged[i, 5] = xx, xy, yy
        staged[i, 6], staged[i, 7], staged[i, 8] = splats[v, CONIC_XX], splats[v, CONIC_XY], splats[v, CONIC_YY]
        staged[i, _STAGED] = splats[v, DEPTH]
        row = np.uint64(rows[v])
        for channel in range(geometry):
            staged[i, np.uint64(_STAGED + 1) + channel] = channels[row, channel]


@numba.njit(cache=True, error_model="numpy", fastmath=FAST)
def _contract_later_blocks(scratch, splat, blocks, first, last):
    """Gradient of alpha plus that of the geometry channels beyond the first block, contracted with a splat's values."""
    for q in range(first, last):
        scratch[_GRAD_REST + q] = scratch[_GRAD_ALPHA + q]
    for k in range(_BLOCK, blocks * _BLOCK):
        value, place = splat[np.uint64(_STAGED) + k], _GRADS + k * STRIDE
        for q in range(first, last):
            scratch[_GRAD_REST + q] += scratch[place + q] * value


@numba.njit(cache=True, error_model="numpy", fastmath=_REORDERED)
def _fragment_sums(scratch, splat, first, last, min_alpha, max_alpha, min_transmittance, sums):
    """Blend one splat over its pixels as the forward pass did, keep the weights and sum d in eight ways."""
    x, y, base, xx, xy, yy = splat[0], splat[1], splat[2], splat[3], splat[4], splat[5]
    conic_xx, conic_xy, conic_yy = splat[6], splat[7], splat[8]
    value0, value1, value2, value3 = splat[9], splat[10], splat[11], splat[12]
    sum_d = sum_x = sum_y = sum_xx = sum_xy = sum_yy = abs_x = abs_y = np.float32(0)
    for q in range(first, last):
        dx, dy = scratch[_X + q] - x, scratch[_Y + q] - y
        raw = power_of_two(max(base + yy * dy * dy + dx * (xy * dy + xx * dx), FLOOR))
        alpha = min(raw, max_alpha) if raw >= min_alpha else np.float32(0)
        before = scratch[_TRANSMITTANCE + q]
        after = before - before * alpha
        goes_on = after > min_transmittance
        weight = before - after if goes_on else np.float32(0)
        scratch[_WEIGHT + q] = weight
        scratch[_TRANSMITTANCE + q] = after if goes_on else -abs(before)

        grad = scratch[_GRAD_REST + q] + (
            (scratch[_GRADS + q] * value0 + scratch[_GRADS + STRIDE + q] * value1)
            + (
                scratch[_GRADS + np.uint64(2) * STRIDE + q] * value2
                + scratch[_GRADS + np.uint64(3) * STRIDE + q] * value3
            )
        )
        behind = scratch[_BEHIND + q] - weight * grad
        scratch[_BEHIND + q] = behind
        d = raw * (before * grad - behind / (np.float32(1) - alpha))
        d = d if goes_on and raw >= min_alpha and raw <= max_alpha else np.float32(0)
        d_x, d_y = d * dx, d * dy
        sum_d += d
        sum_x += d_x
        sum_y += d_y
        sum_xx += d_x * dx
        sum_xy += d_x * dy
        sum_yy += d_y * dy
        abs_x += abs(conic_xx * d_x + conic_xy * d_y)
        abs_y += abs(conic_xy * d_x + conic_yy * d_y)
    sums[SUM_D], sums[SUM_X], sums[SUM_Y] = sum_d, sum_x, sum_y
    sums[SUM_XX], sums[SUM_XY], sums[SUM_YY] = sum_xx, sum_xy, sum_yy
    sums[SUM_ABS_X], sums[SUM_ABS_Y] = abs_x, abs_y


@numba.njit(cache=True, error_model="numpy", fastmath=_REORDERED)
def _channel_sums(scratch, block, first, last):
    """Sums of weight × gradient of one block of channels over a splat's pixels."""
    place = _GRADS + block * _BLOCK * STRIDE
    sum0 = sum1 = sum2 = sum3 = np.float32(0)
    for q in range(first, last):
        weight = scratch[_WEIGHT + q]
        sum0 += weight * scratch[place + q]
        sum1 += weight * scratch[place + STRIDE + q]
        sum2 += weight * scratch[place + np.uint64(2) * STRIDE + q]
        sum3 += weight * scratch[place + np.uint64(3) * STRIDE + q]
    return sum0, sum1, sum2, sum3


@numba.njit(cache=True, error_model="numpy", fastmath=FAST)
def _walk_tile(scratch, staged, sums, arrays, lists, start, stop, left, top, constants, geometry, out):
    splats, rows, channels = arrays
    _, pair_splats, spans = lists
    min_alpha, max_alpha, min_transmittance = constants[2], constants[3], constants[4]
    geometry_blocks = (geometry + _BLOCK) // _BLOCK
    features = np.uint64(channels.shape[1]) - geometry
    feature_blocks = (features + _BLOCK - np.uint64(1)) // _BLOCK
    feature_start = np.uint64(SUM_DEPTH) + geometry_blocks * _BLOCK
    done = start
    while done < stop:
        batch, done = done, min(done + np.uint64(BATCH), stop)
        _stage(staged, splats, rows, channels, geometry, pair_splats, batch, done, left, top, min_alpha)
        for pair in range(batch, done):
            first, last = np.uint64(spans[pair, 0]) * np.uint64(TILE), np.uint64(spans[pair, 1]) * np.uint64(TILE)
            splat = staged[pair - batch]
            if geometry_blocks > np.uint64(1):
                _contract_later_blocks(scratch, splat, geometry_blocks, first, last)
            _fragment_sums(scratch, splat, first, last, min_alpha, max_alpha, min_transmittance, sums)
            for block in range(geometry_blocks + feature_blocks):
                k = np.uint64(SUM_DEPTH) + block * _BLOCK
                sums[k], sums[k + np.uint64(1)], sums[k + np.uint64(2)], sums[k + np.uint64(3)] = _channel_sums(
                    scratch, block, first, last
                )
            for k in range(np.uint64(SUM_CHANNELS) + geometry):
                out[pair, k] = sums[k]
            for k in range(features):
                out[pair, np.uint64(SUM_CHANNELS) + geometry + k] = sums[feature_start + k]
        if not any_alive(scratch, _TRANSMITTANCE):
            break
    for pair in range(done, stop):
        for k in range(np.uint64(out.shape[1])):
            out[pair, k] = np.float32(0)


@numba.njit(cache=True, error_model="numpy")
def _load_tile(scratch, left, top, outputs, grads, geometry):
    """Fill a tile's state before anything is blended."""
    image, depth, alpha = outputs
    grad_image, grad_depth, grad_alpha = grads
    height, width, count = image.shape
    stride, first = np.int64(STRIDE), np.int64(_GRADS)
    feature_start = (geometry + 4) // 4 * 4
    open_tile(scratch, _TRANSMITTANCE, _X, _Y, width - left, height - top)
    for q in range(PIXELS):
        x, y = left + q % TILE, top + q // TILE
        if x >= width or y >= height:
            continue
        scratch[np.int64(_GRAD_ALPHA) + q] = scratch[np.int64(_GRAD_REST) + q] = grad_alpha[y, x]
        scratch[first + q] = grad_depth[y, x]
        behind = grad_alpha[y, x] * alpha[y, x] + grad_depth[y, x] * depth[y, x]
        for channel in range(geometry):
            scratch[first + (1 + channel) * stride + q] = grad_image[y, x, channel]
            behind += grad_image[y, x, channel] * image[y, x, channel]
        for channel in range(geometry, count):
            scratch[first + (feature_start + channel - geometry) * stride + q] = grad_image[y, x, channel]
        scratch[np.int64(_BEHIND) + q] = behind


@numba.njit(cache=True, parallel=True, error_model="numpy", fastmath=FAST)
def _blend_backward(arrays, lists, columns, constants, outputs, grads, geometry, out):
    starts, count = lists[0], outputs[0].shape[2]
    padded_geometry = (geometry + 4) // 4 * 4
    padded = padded_geometry + (count - geometry + 3) // 4 * 4
    for tile in numba.prange(len(starts) - 1):
        left, top = tile % columns * TILE, tile // columns * TILE
        scratch = np.zeros(np.int64(_GRADS) + padded * np.int64(STRIDE), np.float32)
        staged = np.zeros((BATCH, _STAGED + padded_geometry), np.float32)
        sums = np.zeros(SUM_DEPTH + padded, np.float32)
        _load_tile(scratch, left, top, outputs, grads, geometry)
        _walk_tile(
            scratch,
            staged,
            sums,
            arrays,
            lists,
            np.uint64(starts[tile]),
            np.uint64(starts[tile + 1]),
            np.float32(left),
            np.float32(top),
            constants,
            np.uint64(geometry),
            out,
        )
