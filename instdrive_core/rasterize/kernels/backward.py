"""Gradient of the blending: a second walk through each tile, front to back, that recomputes the forward pass.

With g the pixel's gradient contracted with a splat's channels, and S what the splats behind it add to Σ w·g, a
fragment's dL/dα′ is T·g - S / (1 - α′). S starts as the whole pixel, known from the forward pass, and shrinks as the
walk goes on: nothing is stored per fragment, only which rows of a tile a splat changed, and no others are visited.
Sums over a tile's pixels go to one row per pair (tile, splat), the rows of a splat side by side;
`project_backward` adds them in tile order, so the result does not depend on which thread took which tile.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numba
import numpy as np
from jaxtyping import Float32, UInt8
from numpy import ndarray

from instdrive_core.rasterize.kernels.bin import TILE, TileLists
from instdrive_core.rasterize.kernels.blend import (
    ROW,
    STRIDE,
    TILES_PER_TASK,
    Blended,
    allocate_aligned_zeros,
    open_tile,
    prefetch_record,
)
from instdrive_core.rasterize.kernels.buffer_pool import borrow_floats
from instdrive_core.rasterize.kernels.fragment import EIGHTH, FAST, FLOOR, power_of_two
from instdrive_core.rasterize.kernels.settings import RasterSettings
from instdrive_core.rasterize.kernels.simd import (
    add_contracted,
    add_products,
    build_block,
    choose,
    fill_lanes,
    find_lowest_bit,
    greatest,
    least,
    load,
    magnitude,
    make_zero_block,
    store,
    store_first,
    sum_block,
)
from instdrive_core.rasterize.kernels.splat_records import (
    BLOCK,
    RECORD_BASE,
    RECORD_VALUES,
    RECORD_X,
    RECORD_XX,
    RECORD_XY,
    RECORD_Y,
    RECORD_YY,
    count_blocks,
)

# Columns of a pair's row: sums over the pixels of d = dL/dlog α′, with (x, y) = pixel - mean; then depth and channels.
SUM_D, SUM_X, SUM_Y, SUM_XX, SUM_XY, SUM_YY, SUM_ABS_X, SUM_ABS_Y, SUM_DEPTH, SUM_CHANNELS = range(10)

_AHEAD = np.uint64(16)
"""Records are fetched this many pairs before they are read."""
_PLANES = tuple(STRIDE * np.uint64(plane) for plane in range(6))
_TRANSMITTANCE, _X, _Y, _BEHIND, _GRAD_ALPHA, _GRADS = _PLANES
# What a splat's fragments share along a row: the exponent at dx = 0, its slopes there along x and y, and dy.
_STAGED_BASE, _STAGED_SLOPE, _STAGED_SLOPE_Y, _STAGED_Y = (np.uint64(place) for place in (0, 16, 32, 48))

Images = tuple[Float32[ndarray, "h w c"], Float32[ndarray, "h w"], Float32[ndarray, "h w"]]


@dataclass(frozen=True)
class PairSums:
    """Sums of every pair (tile, splat), splat by splat, each splat's in tile order (`TileLists.entries`)."""

    rows: Float32[ndarray, "m width"]
    """Columns as named above; uninitialised where nothing was touched."""
    touched: UInt8[ndarray, " m"]
    """1 where the splat changed a pixel of the tile."""
    geometry_channels: int
    """How many of the first channels count in d."""

    @property
    def feature_column(self) -> int:
        """Column of the first of the other channels: depth and geometry channels are padded to whole blocks."""
        return SUM_DEPTH + BLOCK * count_blocks(1 + self.geometry_channels)


@contextmanager
def blend_backward(
    records: Float32[ndarray, "v width"],
    tiles: TileLists,
    blended: Blended,
    grads: Images,
    geometry_channels: int,
    settings: RasterSettings,
) -> Iterator[PairSums]:
    """The sums, for as long as the scope lasts: their memory is used again.

    Args:
        blended: result of the forward pass with the same records and tiles.
        grads: the loss's gradients with respect to its image, depth and alpha.
    """
    count = len(tiles.splats)
    geometry_blocks = count_blocks(1 + geometry_channels)
    blocks = geometry_blocks + count_blocks(blended.image.shape[2] - geometry_channels)
    width = SUM_DEPTH + BLOCK * blocks
    with borrow_floats(count * width) as space, numba.parallel_chunksize(1):
        sums = PairSums(space.reshape(count, width), np.zeros(count, np.uint8), geometry_channels)
        _blend_backward(
            records,
            (tiles.starts, tiles.splats, tiles.entries, blended.reached),
            (tiles.columns, geometry_channels, geometry_blocks, blocks),
            settings.to_row(),
            (blended.image, blended.depth, blended.alpha),
            grads,
            (sums.rows, sums.touched),
        )
        yield sums


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=FAST)
def _stage(staged, records, at, top, lines):
    """Work out for the tile's sixteen rows what the fragments of one splat share along a row."""
    dy = lines - (records[at + RECORD_Y] - top)
    yy = records[at + RECORD_YY]
    store(staged, _STAGED_BASE, records[at + RECORD_BASE] + yy * dy * dy)
    store(staged, _STAGED_SLOPE, records[at + RECORD_XY] * dy)
    store(staged, _STAGED_SLOPE_Y, (yy + yy) * dy)
    store(staged, _STAGED_Y, dy)


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=FAST)
def _geometry_sums(scratch, staged, weights, records, at, rows, left, geometry_blocks, constants):
    """Blend one splat over its rows as the forward pass did, keep the weights and sum d in eight ways.

    d is summed per column first, times 1, dy and dy²: all moments follow from these.
    """
    min_alpha, max_alpha, min_transmittance = constants[2], constants[3], constants[4]
    zero, one, values = np.float32(0), np.float32(1), at + RECORD_VALUES
    xx = records[at + RECORD_XX]
    dx = load(scratch, _X) - (records[at + RECORD_X] - left)
    cross = records[at + RECORD_XY] * dx
    moment_0 = moment_1 = moment_2 = abs_x = abs_y = fill_lanes(zero)
    while rows != np.uint64(0):
        row = find_lowest_bit(rows)
        rows &= rows - np.uint64(1)
        q = row * ROW
        slope = staged[_STAGED_SLOPE + row] + xx * dx
        raw = power_of_two(greatest(staged[_STAGED_BASE + row] + dx * slope, FLOOR))
        drawn = raw >= min_alpha
        alpha = choose(drawn, least(raw, max_alpha), zero)
        before = load(scratch, _TRANSMITTANCE + q)
        after = before - before * alpha
        goes_on = after > min_transmittance
        weight = choose(goes_on, before - after, zero)
        store(weights, q, weight)
        store(scratch, _TRANSMITTANCE + q, choose(goes_on, after, zero - magnitude(before)))

        grad = load(scratch, _GRAD_ALPHA + q)
        for block in range(geometry_blocks):
            first = block * np.uint64(BLOCK)
            grad = add_contracted(grad, scratch, _GRADS + first * STRIDE + q, STRIDE, records, values + first)
        behind = load(scratch, _BEHIND + q) - weight * grad
        store(scratch, _BEHIND + q, behind)
        d = raw * (before * grad - behind / (one - alpha))
        d = choose(goes_on & drawn & (raw <= max_alpha), d, zero)
        dy = staged[_STAGED_Y + row]
        d_y = d * dy
        moment_0 += d
        moment_1 += d_y
        moment_2 += d_y * dy
        size = magnitude(d)
        abs_x += size * magnitude(slope + xx * dx)
        abs_y += size * magnitude(staged[_STAGED_SLOPE_Y + row] + cross)
    d_x, scale = moment_0 * dx, one / EIGHTH
    return sum_block(
        build_block(moment_0, d_x, moment_1, d_x * dx, moment_1 * dx, moment_2, abs_x * scale, abs_y * scale)
    )


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=FAST)
def _value_sums(scratch, weights, rows, blocks, out, target):
    """Sums of weight · gradient over a splat's rows, of depth and channels, twelve or four of them at a time."""
    done = np.uint64(0)
    while blocks - done >= np.uint64(3):
        first, twelve, todo = done * np.uint64(BLOCK), make_zero_block(12), rows
        while todo != np.uint64(0):
            q = find_lowest_bit(todo) * ROW
            todo &= todo - np.uint64(1)
            twelve = add_products(twelve, load(weights, q), scratch, _GRADS + first * STRIDE + q, STRIDE)
        store_first(12, out, target + first, sum_block(twelve))
        done += np.uint64(3)
    while done < blocks:
        first, four, todo = done * np.uint64(BLOCK), make_zero_block(4), rows
        while todo != np.uint64(0):
            q = find_lowest_bit(todo) * ROW
            todo &= todo - np.uint64(1)
            four = add_products(four, load(weights, q), scratch, _GRADS + first * STRIDE + q, STRIDE)
        store_first(4, out, target + first, sum_block(four))
        done += np.uint64(1)


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=FAST)
def _walk_tile(
    scratch, work, records, width, lists, start, stop, left, top, blocks, constants, out, out_width, touched
):
    staged, weights = work
    _, splats, entries, reached = lists
    geometry_blocks, all_blocks = blocks
    lines = load(scratch, _X)  # 0 … 15, here down the rows
    for pair in range(start, stop):
        prefetch_record(records, np.uint64(splats[min(pair + _AHEAD, stop - np.uint64(1))]) * width)
        rows = np.uint64(reached[pair])
        if rows == np.uint64(0):
            continue
        at, entry = np.uint64(splats[pair]) * width, np.uint64(entries[pair])
        touched[entry] = np.uint8(1)
        _stage(staged, records, at, top, lines)
        sums = _geometry_sums(scratch, staged, weights, records, at, rows, left, geometry_blocks, constants)
        store_first(8, out, entry * out_width, sums)
        _value_sums(scratch, weights, rows, all_blocks, out, entry * out_width + np.uint64(SUM_DEPTH))


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=FAST)
def _load_tile(scratch, left, top, outputs, grads, size, channels, feature_plane):
    """Gradients of a tile's pixels, and S of the whole pixel. Planes between geometry and features stay 0."""
    image, depth, alpha = outputs
    grad_image, grad_depth, grad_alpha = grads
    height, width = size
    count, geometry = channels
    for line in range(min(ROW, height - top)):
        for column in range(min(ROW, width - left)):
            q = line * ROW + column
            pixel = (top + line) * width + left + column
            at = pixel * count
            scratch[_GRAD_ALPHA + q] = grad_alpha[pixel]
            scratch[_GRADS + q] = grad_depth[pixel]
            behind = grad_alpha[pixel] * alpha[pixel] + grad_depth[pixel] * depth[pixel]
            for channel in range(geometry):
                value = grad_image[at + channel]
                scratch[_GRADS + (channel + np.uint64(1)) * STRIDE + q] = value
                behind += value * image[at + channel]
            for channel in range(geometry, count):
                scratch[feature_plane + (channel - geometry) * STRIDE + q] = grad_image[at + channel]
            scratch[_BEHIND + q] = behind


@numba.njit(cache=True, parallel=True, error_model="numpy", fastmath=FAST)
def _blend_backward(records, lists, layout, constants, outputs, grads, out):
    columns, geometry, geometry_blocks, blocks = layout
    height, width, count = outputs[0].shape
    flat_outputs = (outputs[0].reshape(-1), outputs[1].reshape(-1), outputs[2].reshape(-1))
    flat_grads = (grads[0].reshape(-1), grads[1].reshape(-1), grads[2].reshape(-1))
    starts, tiles = lists[0], len(lists[0]) - 1
    for task in numba.prange((tiles + TILES_PER_TASK - 1) // TILES_PER_TASK):
        scratch = allocate_aligned_zeros(np.int64(_GRADS) + BLOCK * blocks * np.int64(STRIDE))
        work = (allocate_aligned_zeros(4 * TILE), allocate_aligned_zeros(TILE * TILE))
        for tile in range(task * TILES_PER_TASK, min(tiles, (task + 1) * TILES_PER_TASK)):
            left, top = tile % columns * TILE, tile // columns * TILE
            if left + TILE > width or top + TILE > height:
                scratch[:] = 0  # pixels outside the image have no gradient
            open_tile(scratch, _TRANSMITTANCE, _X, _Y, width - left, height - top)
            _load_tile(
                scratch,
                np.uint64(left),
                np.uint64(top),
                flat_outputs,
                flat_grads,
                (np.uint64(height), np.uint64(width)),
                (np.uint64(count), np.uint64(geometry)),
                _GRADS + np.uint64(BLOCK * geometry_blocks) * STRIDE,
            )
            _walk_tile(
                scratch,
                work,
                records.reshape(-1),
                np.uint64(records.shape[1]),
                lists,
                np.uint64(starts[tile]),
                np.uint64(starts[tile + 1]),
                np.float32(left),
                np.float32(top),
                (np.uint64(geometry_blocks), np.uint64(blocks)),
                constants,
                out[0].reshape(-1),
                np.uint64(out[0].shape[1]),
                out[1],
            )
