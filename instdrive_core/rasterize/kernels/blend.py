"""Front-to-back blending of the binned splats, tile by tile, a row of sixteen pixels at a time.

One flat float32 array per tile holds everything that is per pixel, in planes of 256. Of each batch of splats every
pixel row first takes those that reach it and works out their weights, its transmittances in a register; then it adds
their channels, its sums in registers. Loop bounds are uint64 because signed indices would be checked for wrap-around;
helpers are inlined by force because arrays handed to a function are counted, atomically, at every call.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from jaxtyping import Float32, UInt16
from numpy import ndarray

from instdrive_core.rasterize.kernels.bin import PIXELS, TILE, TileLists
from instdrive_core.rasterize.kernels.fragment import FAST, FLOOR, power_of_two
from instdrive_core.rasterize.kernels.settings import RasterSettings
from instdrive_core.rasterize.kernels.simd import (
    add_scaled,
    any_lane,
    choose,
    find_lowest_bit,
    find_members_with,
    greatest,
    least,
    load,
    load_block,
    magnitude,
    prefetch,
    store,
    store_block,
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

TILES_PER_TASK = 8
"""Tiles are dealt to threads in tasks of this size, as threads become free."""
BATCH = 64
"""Splats staged at once, one bit of a uint64 each; after each batch a finished tile is left."""

ROW = np.uint64(TILE)
STRIDE = np.uint64(PIXELS + TILE)  # planes one line apart, so that they do not fall on the same cache sets
_TRANSMITTANCE, _X, _Y, _VALUES = (STRIDE * np.uint64(plane) for plane in range(4))
_LINE = np.uint64(16)
"""Floats per cache line."""

# A staged splat: the exponent at dx = 0 for the tile's sixteen rows, its slope there, then mean x and xx.
_STAGED_BASE, _STAGED_SLOPE, _STAGED_X, _STAGED_XX, _STAGED = (np.uint64(place) for place in (0, 16, 32, 33, 48))


@dataclass(frozen=True)
class Blended:
    """Image Σ w·channels, depth Σ w·z, alpha Σ w, and what spares the backward pass a search."""

    image: Float32[ndarray, "h w c"]
    depth: Float32[ndarray, "h w"]
    alpha: Float32[ndarray, "h w"]
    reached: UInt16[ndarray, " m"]
    """For every pair (tile, splat) the tile's rows, as bits, in which the splat changed an unfinished pixel."""


def blend(
    records: Float32[ndarray, "v width"],
    tiles: TileLists,
    channels: int,
    width: int,
    height: int,
    settings: RasterSettings,
) -> Blended:
    """Blend records (see `pack_records`) with this many channels."""
    blended = Blended(
        np.empty((height, width, channels), np.float32),
        np.empty((height, width), np.float32),
        np.empty((height, width), np.float32),
        np.zeros(len(tiles.splats), np.uint16),
    )
    with numba.parallel_chunksize(1):
        _blend(
            records,
            (tiles.starts, tiles.splats, tiles.spans),
            tiles.columns,
            count_blocks(1 + channels),
            settings.to_row(),
            (blended.image, blended.depth, blended.alpha),
            blended.reached,
        )
    return blended


@numba.njit(cache=True, error_model="numpy")
def allocate_aligned_zeros(count):
    """Allocate float32 zeros that begin with a cache line, so that no load of lanes crosses one."""
    space = np.zeros(count + 16, np.float32)
    skip = -(np.int64(space.ctypes.data) >> 2) & 15
    return space[skip : skip + count]


@numba.njit(cache=True, forceinline=True, error_model="numpy")
def open_tile(scratch, transmittance, x, y, width, height):
    """Start a tile with nothing blended; pixels outside the image, `width` × `height` from its corner, are finished."""
    for q in range(np.uint64(PIXELS)):
        column, row = q % np.uint64(TILE), q // np.uint64(TILE)
        scratch[x + q], scratch[y + q] = column, row
        scratch[transmittance + q] = 1 if np.int64(column) < width and np.int64(row) < height else -1


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=FAST)
def has_open_pixel(scratch, transmittance):
    """Whether a pixel of the tile still lets light through; finished ones carry a negative transmittance."""
    alive = np.int32(0)
    for q in range(np.uint64(PIXELS)):
        alive += np.int32(scratch[transmittance + q] > np.float32(0))
    return alive > 0


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=FAST)
def prefetch_record(records, place):
    """Fetch a record's first two cache lines, all of it with up to eleven channels."""
    prefetch(records, place)
    prefetch(records, place + _LINE)


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=FAST)
def _stage(scratch, work, records, width, lists, start, stop, left, top):
    """Prepare a batch of splats: exponents of each row, which rows they reach, where their records are."""
    staged, places, masks = work[0], work[1], work[2]
    _, splats, spans = lists
    lines = load(scratch, _X)  # 0 … 15, here down the rows
    one = np.uint64(1)
    for i in range(np.uint64(BATCH)):
        masks[i] = np.uint16(0)
    for pair in range(start, stop):
        i = pair - start
        at, target = np.uint64(splats[pair]) * width, i * _STAGED
        places[i] = at
        dy = lines - (records[at + RECORD_Y] - top)
        store(staged, target + _STAGED_BASE, records[at + RECORD_BASE] + records[at + RECORD_YY] * dy * dy)
        store(staged, target + _STAGED_SLOPE, records[at + RECORD_XY] * dy)
        staged[target + _STAGED_X] = records[at + RECORD_X] - left
        staged[target + _STAGED_XX] = records[at + RECORD_XX]
        masks[i] = np.uint16((one << np.uint64(spans[pair, 1])) - (one << np.uint64(spans[pair, 0])))


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=FAST)
def _weigh_row(scratch, work, row, todo, constants):
    """Weights of the splats `todo` (a set of bits) in one row, and where the values of those with any are."""
    staged, places, reached, weights, kept_places = work[0], work[1], work[3], work[4], work[5]
    min_alpha, max_alpha, min_transmittance = constants[2], constants[3], constants[4]
    zero, one = np.float32(0), np.uint64(1)
    columns = load(scratch, _X)
    before = load(scratch, _TRANSMITTANCE + row * ROW)
    kept = np.uint64(0)
    while todo != np.uint64(0):
        i = find_lowest_bit(todo)
        todo &= todo - one
        at = i * _STAGED
        dx = columns - staged[at + _STAGED_X]
        slope = staged[at + _STAGED_SLOPE + row] + staged[at + _STAGED_XX] * dx
        raw = power_of_two(greatest(staged[at + _STAGED_BASE + row] + dx * slope, FLOOR))
        drawn = raw >= min_alpha
        after = before - before * choose(drawn, least(raw, max_alpha), zero)
        goes_on = after > min_transmittance  # never true again once the sign is negative
        store(weights, kept * ROW, choose(goes_on, before - after, zero))
        kept_places[kept] = places[i] + RECORD_VALUES
        changed = np.uint64(any_lane(drawn & (before > zero)))
        reached[i] |= changed << row
        kept += changed  # without a branch: the next splat takes the place of one that changed nothing
        before = choose(goes_on, after, zero - magnitude(before))
    store(scratch, _TRANSMITTANCE + row * ROW, before)
    return kept


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=FAST)
def _add_values(scratch, work, records, row, kept, blocks):
    """Add weight · value of the splats kept to one row's depth and channels, twelve or four of them at a time."""
    weights, places = work[4], work[5]
    done = np.uint64(0)
    while blocks - done >= np.uint64(3):
        first, target = done * np.uint64(BLOCK), _VALUES + done * np.uint64(BLOCK) * STRIDE + row * ROW
        twelve = load_block(12, scratch, target, STRIDE)
        for j in range(kept):
            twelve = add_scaled(twelve, load(weights, j * ROW), records, places[j] + first)
        store_block(scratch, target, STRIDE, twelve)
        done += np.uint64(3)
    while done < blocks:
        first, target = done * np.uint64(BLOCK), _VALUES + done * np.uint64(BLOCK) * STRIDE + row * ROW
        four = load_block(4, scratch, target, STRIDE)
        for j in range(kept):
            four = add_scaled(four, load(weights, j * ROW), records, places[j] + first)
        store_block(scratch, target, STRIDE, four)
        done += np.uint64(1)


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=FAST)
def _blend_tile(scratch, work, records, width, blocks, lists, start, stop, left, top, constants, out_reached):
    splats, masks, reached = lists[1], work[2], work[3]
    end = min(start + np.uint64(BATCH), stop)
    while start < end:
        upcoming = min(end + np.uint64(BATCH), stop)
        for pair in range(end, upcoming):  # while this batch is blended
            prefetch_record(records, np.uint64(splats[pair]) * width)
        _stage(scratch, work, records, width, lists, start, end, left, top)
        for i in range(end - start):
            reached[i] = np.uint64(0)
        for row in range(ROW):
            todo = find_members_with(masks, row)
            if todo != np.uint64(0) and any_lane(load(scratch, _TRANSMITTANCE + row * ROW) > np.float32(0)):
                kept = _weigh_row(scratch, work, row, todo, constants)
                _add_values(scratch, work, records, row, kept, blocks)
        for i in range(end - start):
            out_reached[start + i] = reached[i]
        start, end = end, upcoming
        if not has_open_pixel(scratch, _TRANSMITTANCE):
            break


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=FAST)
def _write_tile(scratch, left, top, images, height, width, count):
    """Copy a blended tile into the images."""
    image, depth, alpha = images
    for line in range(min(ROW, height - top)):
        for column in range(min(ROW, width - left)):
            q, pixel = line * ROW + column, (top + line) * width + left + column
            alpha[pixel] = np.float32(1) - abs(scratch[_TRANSMITTANCE + q])
            depth[pixel] = scratch[_VALUES + q]
            for channel in range(count):
                image[pixel * count + channel] = scratch[_VALUES + (np.uint64(1) + channel) * STRIDE + q]


@numba.njit(cache=True, parallel=True, error_model="numpy", fastmath=FAST)
def _blend(records, lists, columns, blocks, constants, images, reached):
    height, width, count = images[0].shape
    flat = (images[0].reshape(-1), images[1].reshape(-1), images[2].reshape(-1))
    starts, tiles = lists[0], len(lists[0]) - 1
    for task in numba.prange((tiles + TILES_PER_TASK - 1) // TILES_PER_TASK):
        scratch = allocate_aligned_zeros(np.int64(_VALUES) + BLOCK * blocks * np.int64(STRIDE))
        work = (
            allocate_aligned_zeros(BATCH * np.int64(_STAGED)),
            np.empty(BATCH, np.uint64),
            np.empty(BATCH, np.uint16),
            np.empty(BATCH, np.uint64),
            allocate_aligned_zeros(BATCH * TILE),
            np.empty(BATCH, np.uint64),
        )
        for tile in range(task * TILES_PER_TASK, min(tiles, (task + 1) * TILES_PER_TASK)):
            left, top = tile % columns * TILE, tile // columns * TILE
            scratch[np.int64(_VALUES) :] = 0
            open_tile(scratch, _TRANSMITTANCE, _X, _Y, width - left, height - top)
            _blend_tile(
                scratch,
                work,
                records.reshape(-1),
                np.uint64(records.shape[1]),
                np.uint64(blocks),
                lists,
                np.uint64(starts[tile]),
                np.uint64(starts[tile + 1]),
                np.float32(left),
                np.float32(top),
                constants,
                reached,
            )
            _write_tile(
                scratch, np.uint64(left), np.uint64(top), flat, np.uint64(height), np.uint64(width), np.uint64(count)
            )
