"""Front-to-back blending of a preview: colour, depth and the splat that each pixel stands for, in one walk.

Tiles are blended as in `blend`, a row of sixteen pixels at a time. Who wins a pixel is decided on the way: the first
solid splat claims it, and the one with which its transmittance falls to a half is noted. That is the median splat too
unless the pixel stays somewhat transparent: only such pixels, and only where they ask for their median splat, are
walked a second time.
"""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float32, Int32
from numpy import ndarray

from instdrive_core.rasterize.bin import TILE
from instdrive_core.rasterize.blend import (
    BATCH,
    ROW,
    STRIDE,
    TILES_PER_TASK,
    aligned_zeros,
    any_alive,
    open_tile,
)
from instdrive_core.rasterize.fragment import FAST, FLOOR, power_of_two
from instdrive_core.rasterize.lanes import (
    add_scaled,
    any_lane,
    choose,
    greatest,
    lane_bits,
    least,
    load,
    load_block,
    lowest_bit,
    magnitude,
    members_with,
    prefetch,
    spread,
    store,
    store_block,
)
from instdrive_core.rasterize.preview_splats import (
    AT_BASE,
    AT_OPACITY,
    AT_ROW,
    AT_VALUES,
    AT_X,
    AT_XX,
    AT_XY,
    AT_Y,
    AT_YY,
    SPLAT_FLOATS,
)
from instdrive_core.rasterize.preview_tiles import PreviewTiles
from instdrive_core.rasterize.settings import RasterSettings

_WIDTH = np.uint64(SPLAT_FLOATS)
# Planes of a tile. Winners are kept as 1 + place in the tile's list, exact in float32 up to 2²⁴; 0 = none yet.
_PLANES = tuple(STRIDE * np.uint64(plane) for plane in range(12))
_TRANSMITTANCE, _X, _Y, _WINNER, _WINNER_WEIGHT, _HALF, _BEFORE_HALF, _GOAL, _VALUES = _PLANES[:9]
_SCRATCH = int(_VALUES) + 4 * int(STRIDE)
# A staged splat: the exponent at dx = 0 for the tile's sixteen rows, its slope there, then mean x and xx, the alpha
# from which its fragments are solid, and its number in the tile.
_STAGED_BASE, _STAGED_SLOPE, _STAGED_X, _STAGED_XX, _STAGED_SOLID, _STAGED_NUMBER, _STAGED = (
    np.uint64(place) for place in (0, 16, 32, 33, 34, 35, 48)
)
_NEVER = np.float32(2)
"""No fragment has this alpha."""
_SLACK = np.float32(1e-4)
"""Of exponents, so that rounding never loses a row with a fragment that the alpha test would keep."""


def blend_preview(
    packed: Float32[ndarray, "v 16"],
    tiles: PreviewTiles,
    settings: RasterSettings,
    rule: Float32[ndarray, " 4"],
    images: tuple[Float32[ndarray, "h w 3"], Float32[ndarray, "h w"], Float32[ndarray, "h w"], Int32[ndarray, "h w"]],
) -> None:
    """Write colour (premultiplied), alpha, depth and winner as `Preview` holds them. `rule` is a `PickRule`'s row."""
    lists = (tiles.starts, tiles.splats)
    with numba.parallel_chunksize(1):
        _blend(packed.reshape(-1), packed.view(np.int32), lists, tiles.columns, settings.as_row(), rule, images)


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=FAST)
def _stage(scratch, work, packed, splats, start, stop, first, left, top, constants, rule):
    """Prepare a batch of splats: exponents of each row, which rows they reach, where their values are."""
    staged, places, masks = work[0], work[1], work[2]
    lines = load(scratch, _X)  # 0 … 15, here down the rows
    zero, one = np.float32(0), np.uint64(1)
    faintest = np.float32(0.125) * np.log2(constants[2]) - _SLACK
    for i in range(np.uint64(BATCH)):
        masks[i] = np.uint16(0)
    for pair in range(start, stop):
        i = pair - start
        at, target = np.uint64(splats[pair]) * _WIDTH, i * _STAGED
        places[i] = at
        dy = lines - (packed[at + AT_Y] - top)
        base, slope = packed[at + AT_BASE] + packed[at + AT_YY] * dy * dy, packed[at + AT_XY] * dy
        x, xx = packed[at + AT_X] - left, packed[at + AT_XX]
        store(staged, target + _STAGED_BASE, base)
        store(staged, target + _STAGED_SLOPE, slope)
        staged[target + _STAGED_X], staged[target + _STAGED_XX] = x, xx
        staged[target + _STAGED_SOLID] = rule[1] if packed[at + AT_OPACITY] >= rule[0] else _NEVER
        staged[target + _STAGED_NUMBER] = np.float32(np.int64(pair - first + one))
        # The exponent is a parabola along a row; the row is reached where its top within the tile is drawn.
        peak = least(greatest(slope * (np.float32(-0.5) / xx), zero - x), np.float32(TILE - 1) - x)
        masks[i] = lane_bits(base + peak * (slope + peak * xx) >= faintest)


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=FAST)
def _weigh_row(scratch, work, row, todo, constants):
    """Weights of the splats `todo` (a set of bits) in one row, and where the values of those with any are."""
    staged, places, weights, kept_places = work[0], work[1], work[3], work[4]
    min_alpha, max_alpha, min_transmittance = constants[2], constants[3], constants[4]
    zero, half, one = np.float32(0), np.float32(0.5), np.uint64(1)
    at_row = row * ROW
    columns, before = load(scratch, _X), load(scratch, _TRANSMITTANCE + at_row)
    winner, winner_weight = load(scratch, _WINNER + at_row), load(scratch, _WINNER_WEIGHT + at_row)
    half_at, before_half = load(scratch, _HALF + at_row), load(scratch, _BEFORE_HALF + at_row)
    undecided = any_lane(before > half) | any_lane((before > zero) & (winner <= zero))
    kept = np.uint64(0)
    while todo != np.uint64(0):
        i = lowest_bit(todo)
        todo &= todo - one
        at = i * _STAGED
        dx = columns - staged[at + _STAGED_X]
        slope = staged[at + _STAGED_SLOPE + row] + staged[at + _STAGED_XX] * dx
        raw = power_of_two(greatest(staged[at + _STAGED_BASE + row] + dx * slope, FLOOR))
        drawn = raw >= min_alpha
        after = before - before * choose(drawn, least(raw, max_alpha), zero)
        goes_on = after > min_transmittance  # never true again once the sign is negative
        weight = choose(goes_on, before - after, zero)
        store(weights, kept * ROW, weight)
        kept_places[kept] = places[i] + AT_VALUES
        kept += np.uint64(any_lane(weight > zero))  # without a branch: the next takes the place of one without weight
        if undecided:
            number = spread(staged[at + _STAGED_NUMBER])
            claims = (weight > zero) & (raw >= staged[at + _STAGED_SOLID]) & (winner <= zero)
            winner, winner_weight = choose(claims, number, winner), choose(claims, weight, winner_weight)
            halves = goes_on & (after <= half) & (before > half)
            half_at, before_half = choose(halves, number, half_at), choose(halves, before, before_half)
        before = choose(goes_on, after, zero - magnitude(before))
    store(scratch, _TRANSMITTANCE + at_row, before)
    store(scratch, _WINNER + at_row, winner)
    store(scratch, _WINNER_WEIGHT + at_row, winner_weight)
    store(scratch, _HALF + at_row, half_at)
    store(scratch, _BEFORE_HALF + at_row, before_half)
    return kept


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=FAST)
def _reach_goal(scratch, work, row, todo, constants):
    """Make winners of the splats with which a pixel's transmittance falls to its goal, and finish those pixels."""
    staged = work[0]
    min_alpha, max_alpha, min_transmittance = constants[2], constants[3], constants[4]
    zero, one = np.float32(0), np.uint64(1)
    at_row = row * ROW
    columns, before = load(scratch, _X), load(scratch, _TRANSMITTANCE + at_row)
    winner, goal = load(scratch, _WINNER + at_row), load(scratch, _GOAL + at_row)
    while todo != np.uint64(0):
        i = lowest_bit(todo)
        todo &= todo - one
        at = i * _STAGED
        dx = columns - staged[at + _STAGED_X]
        slope = staged[at + _STAGED_SLOPE + row] + staged[at + _STAGED_XX] * dx
        raw = power_of_two(greatest(staged[at + _STAGED_BASE + row] + dx * slope, FLOOR))
        after = before - before * choose(raw >= min_alpha, least(raw, max_alpha), zero)
        goes_on = after > min_transmittance
        wins = goes_on & (before > after) & (after <= goal)
        winner = choose(wins, spread(staged[at + _STAGED_NUMBER]), winner)
        before = choose(goes_on, choose(wins, zero - after, after), zero - magnitude(before))
    store(scratch, _TRANSMITTANCE + at_row, before)
    store(scratch, _WINNER + at_row, winner)


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=FAST)
def _add_values(scratch, work, packed, row, kept):
    """Add weight · (depth, colour) of the splats kept to one row."""
    weights, places = work[3], work[4]
    target = _VALUES + row * ROW
    four = load_block(4, scratch, target, STRIDE)
    for j in range(kept):
        four = add_scaled(four, load(weights, j * ROW), packed, places[j])
    store_block(scratch, target, STRIDE, four)


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=FAST)
def _walk(scratch, work, packed, splats, start, stop, left, top, constants, rule, median):
    """Blend a tile's splats; with `median` only find the splats that undecided pixels stand for."""
    masks, first = work[2], start
    end = min(start + np.uint64(BATCH), stop)
    while start < end:
        upcoming = min(end + np.uint64(BATCH), stop)
        for pair in range(end, upcoming):  # while this batch is blended
            prefetch(packed, np.uint64(splats[pair]) * _WIDTH)
        _stage(scratch, work, packed, splats, start, end, first, left, top, constants, rule)
        for row in range(ROW):
            todo = members_with(masks, row)
            if todo != np.uint64(0) and any_lane(load(scratch, _TRANSMITTANCE + row * ROW) > np.float32(0)):
                if median:
                    _reach_goal(scratch, work, row, todo, constants)
                else:
                    kept = _weigh_row(scratch, work, row, todo, constants)
                    _add_values(scratch, work, packed, row, kept)
        start, end = end, upcoming
        if not any_alive(scratch, _TRANSMITTANCE):
            break


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=FAST)
def _judge(scratch, rule):
    """Judge the winners. Pixels that stand for their median splat get it where it is known; the others that do start
    afresh, and whether there are any is returned."""
    one, half, undecided = np.float32(1), np.float32(0.5), np.int32(0)
    for q in range(ROW * ROW):
        total = one - abs(scratch[_TRANSMITTANCE + q])
        winner = scratch[_WINNER + q]
        floating = (winner > np.float32(0)) & (scratch[_WINNER_WEIGHT + q] < rule[2] * total)
        asks = floating | ((winner == np.float32(0)) & (total >= rule[3]))
        goal = one - half * total
        known = asks & (scratch[_BEFORE_HALF + q] > goal)  # at least a half: no splat before reached it
        scratch[_WINNER + q] = scratch[_HALF + q] if known else winner
        scratch[_GOAL + q] = goal
        restarts = asks & (not known)
        scratch[_TRANSMITTANCE + q] = one if restarts else -one
        undecided += np.int32(restarts)
    return undecided > 0


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=FAST)
def _write_tile(scratch, left, top, images, height, width):
    """Copy a blended tile into the images."""
    color, alpha, depth = images
    zero = np.float32(0)
    for line in range(min(ROW, height - top)):
        for column in range(min(ROW, width - left)):
            q, pixel = line * ROW + column, (top + line) * width + left + column
            total = np.float32(1) - abs(scratch[_TRANSMITTANCE + q])
            alpha[pixel] = total
            depth[pixel] = scratch[_VALUES + q] / total if total > zero else zero
            for channel in range(np.uint64(3)):
                color[pixel * np.uint64(3) + channel] = scratch[_VALUES + (np.uint64(1) + channel) * STRIDE + q]


@numba.njit(cache=True, forceinline=True, error_model="numpy")
def _write_winners(scratch, left, top, winner, rows, splats, start, height, width):
    """From numbers in the tile's list to rows of the scene."""
    for line in range(min(ROW, height - top)):
        for column in range(min(ROW, width - left)):
            number = np.int64(scratch[_WINNER + line * ROW + column])
            pixel = (top + line) * width + left + column
            if number == 0:
                winner[pixel] = -1
            else:
                winner[pixel] = rows[np.uint64(splats[start + np.uint64(number - 1)]), AT_ROW]


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy", fastmath=FAST)
def _blend(packed, rows, lists, columns, constants, rule, images):
    height, width, _ = images[0].shape
    flat = (images[0].reshape(-1), images[1].reshape(-1), images[2].reshape(-1))
    winner = images[3].reshape(-1)
    starts, splats, tiles = lists[0], lists[1], len(lists[0]) - 1
    for task in numba.prange((tiles + TILES_PER_TASK - 1) // TILES_PER_TASK):
        scratch = aligned_zeros(_SCRATCH)
        work = (
            aligned_zeros(BATCH * np.int64(_STAGED)),
            np.empty(BATCH, np.uint64),
            np.empty(BATCH, np.uint16),
            aligned_zeros(BATCH * TILE),
            np.empty(BATCH, np.uint64),
        )
        for tile in range(task * TILES_PER_TASK, min(tiles, (task + 1) * TILES_PER_TASK)):
            left, top = tile % columns * TILE, tile // columns * TILE
            start, stop = np.uint64(starts[tile]), np.uint64(starts[tile + 1])
            scratch[np.int64(_WINNER) :] = 0
            open_tile(scratch, _TRANSMITTANCE, _X, _Y, width - left, height - top)
            x, y = np.float32(left), np.float32(top)
            _walk(scratch, work, packed, splats, start, stop, x, y, constants, rule, False)
            corner, size = (np.uint64(left), np.uint64(top)), (np.uint64(height), np.uint64(width))
            _write_tile(scratch, corner[0], corner[1], flat, size[0], size[1])
            if _judge(scratch, rule):
                _walk(scratch, work, packed, splats, start, stop, x, y, constants, rule, True)
            _write_winners(scratch, corner[0], corner[1], winner, rows, splats, start, size[0], size[1])
