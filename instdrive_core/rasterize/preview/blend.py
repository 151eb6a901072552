"""Front-to-back blending of a preview: colour, depth and the splat that each pixel stands for, in one walk.

Tiles are blended a block of 4 × 4 pixels at a time. Who wins a pixel (`PickRule`) is counted on the way, until what is
still to come cannot change it.
"""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float32, Int32
from numpy import ndarray

from instdrive_core.rasterize.kernels.bin import TILE
from instdrive_core.rasterize.kernels.blend import TILES_PER_TASK
from instdrive_core.rasterize.kernels.fragment import FAST, power_of_two
from instdrive_core.rasterize.kernels.settings import RasterSettings
from instdrive_core.rasterize.kernels.simd import (
    add_scaled,
    any_lane,
    choose,
    exclude_lanes,
    fill_lanes,
    find_lowest_bit,
    find_members_with,
    greatest,
    least,
    load,
    load_block,
    magnitude,
    pack_lane_bits,
    prefetch,
    store,
    store_block,
    unpack_lane_bits,
)
from instdrive_core.rasterize.preview.output import fetch_pictures, judge_winners, write_tile, write_winners
from instdrive_core.rasterize.preview.scratch import (
    BATCH,
    BLOCKS,
    COLUMN,
    FIRST,
    FIRST_LIGHT,
    FIRST_WEIGHT,
    LANES,
    LINE,
    SECOND,
    SECOND_LIGHT,
    SECOND_ROW,
    SECOND_WEIGHT,
    STRIDE,
    TRANSMITTANCE,
    VALUES,
    WINNER,
    new_scratch,
    reset_scratch,
)
from instdrive_core.rasterize.preview.splats import (
    AT_A,
    AT_B,
    AT_BASE,
    AT_C,
    AT_INSTANCE,
    AT_OPACITY,
    AT_ROW,
    AT_VALUES,
    AT_X,
    AT_Y,
    SPLAT_FLOATS,
)
from instdrive_core.rasterize.preview.tile_order import new_counters, order_tile
from instdrive_core.rasterize.preview.tiles import PreviewTiles

_WIDTH = np.uint64(SPLAT_FLOATS)
# A staged splat is its line, but for a·dx + b·dy and c·dy at the tile's corner in the places of its mean, and the
# alpha from which its fragments are solid in the place of its opacity.
_STAGED_U, _STAGED_V, _STAGED_SOLID = AT_X, AT_Y, AT_OPACITY
_SHARE = np.uint64(BATCH) // BLOCKS
"""Splats of the next batch that are fetched before each block."""
_NEVER = np.float32(2)
"""No fragment has this alpha."""
_PASSED = np.float32(3)
"""Instead of an alpha: the splat is nameless, and the next one behind it wins what it would."""
_FROM_CENTER = np.float32(1.5)
"""Pixels from a block's centre to the centres of its outermost pixels, along each axis."""
_SLACK = np.float32(1e-4)
"""Slack of exponents, so that rounding never loses a block with a fragment that is drawn."""


def blend_preview(
    lines: Float32[ndarray, "n 16"],
    tiles: PreviewTiles,
    settings: RasterSettings,
    rule: Float32[ndarray, " 4"],
    behind: Float32[ndarray, " 3"],
    images: tuple[Float32[ndarray, "h w 3"], Float32[ndarray, "h w"], Float32[ndarray, "h w"], Int32[ndarray, "h w"]],
) -> None:
    """Write colour, alpha, depth and winner as `Preview` holds them.

    `lines` are those of `ProjectedSplats`, `rule` is a `PickRule`'s row, `behind` an RGB.
    """
    color, alpha, depth, winner = images
    pictures = color.reshape(-1), alpha.reshape(-1), depth.reshape(-1), winner.reshape(-1).view(np.float32)
    size = np.array([*alpha.shape, tiles.columns], np.int64)
    limits = settings.min_alpha, settings.max_alpha, settings.min_transmittance, 0.125 * np.log2(settings.min_alpha)
    lists = tiles.starts, tiles.entries
    with numba.parallel_chunksize(1):
        _blend(lines.reshape(-1), *lists, size, np.array(limits, np.float32), rule, behind, pictures)


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=FAST)
def _fetch(records, splats, start, stop):
    """Have splats fetched that will soon be staged."""
    for pair in range(start, stop):
        prefetch(records, np.uint64(splats[pair]) * _WIDTH)


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=FAST)
def _stage(scratch, records, splats, start, stop, corner, limits, rule):
    """Prepare a batch of splats: what they are in the tile, and which blocks they reach."""
    staged, blocks = scratch.staged, scratch.blocks
    columns, lines = load(scratch.centers, np.uint64(0)), load(scratch.centers, BLOCKS)
    zero, faintest = fill_lanes(np.float32(0)), limits[3] - _SLACK
    solid = max(rule[1], limits[0])
    for slot in range(np.uint64(BATCH)):
        blocks[slot] = np.uint16(0)
    for pair in range(start, stop):
        slot, at = pair - start, np.uint64(splats[pair]) * _WIDTH
        target = slot * LANES
        a, b, c = records[at + AT_A], records[at + AT_B], records[at + AT_C]
        x, y = records[at + AT_X] - corner[0], records[at + AT_Y] - corner[1]
        corner_u, corner_v = -(a * x + b * y), -c * y
        store(staged, target, load(records, at))
        staged[target + _STAGED_U], staged[target + _STAGED_V] = corner_u, corner_v
        opacity = records[at + AT_OPACITY]
        fragments = solid if opacity >= rule[0] else _NEVER
        staged[target + _STAGED_SOLID] = _PASSED if opacity < np.float32(0) else fragments
        # In u and v a block is a parallelogram. How near the rectangle around it comes to the mean bounds exponents.
        u, v = columns * a + lines * b + corner_u, lines * c + corner_v
        u = greatest(magnitude(u) - _FROM_CENTER * (a + abs(b)), zero)
        v = greatest(magnitude(v) - _FROM_CENTER * c, zero)
        nearest = u * u + v * v
        blocks[slot] = pack_lane_bits(nearest <= records[at + AT_BASE] - faintest)


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=FAST)
def _alpha(staged, at, columns, lines, limits):
    """Compute α′ of a staged splat's fragments; 0 for those that are not drawn."""
    u = staged[at + _STAGED_U] + staged[at + AT_B] * lines + staged[at + AT_A] * columns
    v = staged[at + _STAGED_V] + staged[at + AT_C] * lines
    exponent = staged[at + AT_BASE] - v * v - u * u
    return choose(exponent >= limits[3], least(power_of_two(exponent), limits[1]), np.float32(0))


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=FAST)
def _blend_block(scratch, block, todo, limits, nearest):
    """Blend the splats `todo` (bits; slots) into one block."""
    planes, staged, at_block = scratch.planes, scratch.staged, block * LANES
    min_transmittance = limits[2]
    zero, one, bit = fill_lanes(np.float32(0)), fill_lanes(np.float32(1)), np.uint64(1)
    columns, lines = load(planes, COLUMN + at_block), load(planes, LINE + at_block)
    before, values = load(planes, TRANSMITTANCE + at_block), load_block(4, planes, VALUES + at_block, STRIDE)
    still_open, undecided = unpack_lane_bits(scratch.open[block]), unpack_lane_bits(scratch.undecided[block])
    unclaimed = unpack_lane_bits(scratch.unclaimed[block])
    while todo != np.uint64(0) and any_lane(still_open):
        at = find_lowest_bit(todo) * LANES
        todo &= todo - bit
        alpha = _alpha(staged, at, columns, lines, limits)
        after = before - before * alpha
        still_open = still_open & (after > min_transmittance)
        weight = choose(still_open, before - after, zero)
        values = add_scaled(values, weight, staged, at + AT_VALUES)
        if any_lane(undecided) and staged[at + _STAGED_SOLID] < _PASSED:
            claims = still_open & unclaimed & (alpha >= staged[at + _STAGED_SOLID])
            unclaimed = exclude_lanes(unclaimed, claims)
            voice = choose(undecided, choose(claims, one, zero) if nearest else weight, zero)
            left = choose(still_open, after, zero)
            undecided = exclude_lanes(undecided, _count_voice(planes, at_block, staged, at, voice, left))
        before = choose(still_open, after, before)
    scratch.open[block], scratch.undecided[block] = pack_lane_bits(still_open), pack_lane_bits(undecided)
    scratch.unclaimed[block] = pack_lane_bits(unclaimed)
    store(planes, TRANSMITTANCE + at_block, before)
    store_block(planes, VALUES + at_block, STRIDE, values)


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=FAST)
def _count_voice(planes, at_block, staged, at, voice, left):
    """Count a splat's voices, 0 where it has none, for its instance; returns where the light left decides nothing."""
    zero, name, row = fill_lanes(np.float32(0)), fill_lanes(staged[at + AT_INSTANCE]), fill_lanes(staged[at + AT_ROW])
    speaks, first = voice > zero, load(planes, FIRST + at_block)
    light, other_light = load(planes, FIRST_LIGHT + at_block), load(planes, SECOND_LIGHT + at_block)
    weight, own = load(planes, FIRST_WEIGHT + at_block), voice
    others_speak = exclude_lanes(speaks, (first >= name) & (first <= name))
    if any_lane(others_speak):
        second, other_weight = load(planes, SECOND + at_block), load(planes, SECOND_WEIGHT + at_block)
        is_second = others_speak & (second >= name) & (second <= name)
        stranger, behind = exclude_lanes(others_speak, is_second), other_light >= light
        # A stranger that is heavier than the weaker of the two takes its place.
        ousts_first = stranger & behind & (voice > light)
        ousts_second = exclude_lanes(stranger, behind) & (voice > other_light)
        own = choose(ousts_first, voice, choose(others_speak, zero, voice))
        others = choose(ousts_second, voice, choose(is_second, voice, zero))
        light, weight = choose(ousts_first, zero, light), choose(ousts_first, zero, weight)
        other_light, other_weight = choose(ousts_second, zero, other_light), choose(ousts_second, zero, other_weight)
        store(planes, FIRST + at_block, choose(ousts_first, name, first))
        store(planes, SECOND + at_block, choose(ousts_second, name, second))
        store(planes, SECOND_ROW + at_block, choose(others > other_weight, row, load(planes, SECOND_ROW + at_block)))
        other_light = other_light + others
        store(planes, SECOND_LIGHT + at_block, other_light)
        store(planes, SECOND_WEIGHT + at_block, greatest(other_weight, others))
    light = light + own
    store(planes, FIRST_LIGHT + at_block, light)
    store(planes, WINNER + at_block, choose(own > weight, row, load(planes, WINNER + at_block)))
    store(planes, FIRST_WEIGHT + at_block, greatest(weight, own))
    return magnitude(light - other_light) >= left


@numba.njit(cache=True, forceinline=True, error_model="numpy")
def _any_open(scratch):
    """Whether a pixel of the tile still lets light through."""
    found = np.uint16(0)
    for block in range(BLOCKS):
        found |= scratch.open[block]
    return found != np.uint16(0)


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=FAST)
def _walk(scratch, records, splats, start, stop, corner, limits, rule):
    """Blend a tile's splats."""
    end = min(start + np.uint64(BATCH), stop)
    while start < end:
        upcoming = min(end + np.uint64(BATCH), stop)
        _stage(scratch, records, splats, start, end, corner, limits, rule)
        for block in range(BLOCKS):
            # Some of the next batch are fetched before each block: all at once would have to wait for each other.
            soon = end + block * _SHARE
            for pair in range(soon, min(soon + _SHARE, upcoming)):
                prefetch(records, np.uint64(splats[pair]) * _WIDTH)
            todo = find_members_with(scratch.blocks, block)
            if todo != np.uint64(0) and scratch.open[block] != np.uint16(0):
                _blend_block(scratch, block, todo, limits, rule[3] > np.float32(0))
        start, end = end, upcoming
        if not _any_open(scratch):
            break


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy", fastmath=FAST)
def _blend(records, starts, entries, size, limits, rule, behind, pictures):
    height, width, columns, tiles = np.uint64(size[0]), np.uint64(size[1]), size[2], len(starts) - 1
    color, alpha, depth, winner = pictures[0], pictures[1], pictures[2], pictures[3]
    for task in numba.prange((tiles + TILES_PER_TASK - 1) // TILES_PER_TASK):
        scratch, counters, begin, end = (
            new_scratch(),
            new_counters(),
            task * TILES_PER_TASK,
            (task + 1) * TILES_PER_TASK,
        )
        end, longest = min(tiles, end), np.int64(0)
        for tile in range(begin, end):
            longest = max(longest, starts[tile + 1] - starts[tile])
        room, splats = np.empty(2 * longest, np.uint64), np.empty(2 * longest, np.int32)
        # The next tile's splats lie behind those of the one that is blended, and the other way round.
        start, following = np.uint64(0), np.uint64(longest)
        order_tile(entries, np.uint64(starts[begin]), np.uint64(starts[begin + 1]), counters, room, splats, start)
        for tile in range(begin, end):
            left, top = np.uint64(tile % columns * TILE), np.uint64(tile // columns * TILE)
            stop = start + np.uint64(starts[tile + 1] - starts[tile])
            if tile + 1 < end:
                first, last = np.uint64(starts[tile + 1]), np.uint64(starts[tile + 2])
                order_tile(entries, first, last, counters, room, splats, following)
                _fetch(records, splats, following, following + min(last - first, np.uint64(BATCH)))
            fetch_pictures(left, top, (color, alpha, depth), winner, height, width)
            corner = np.float32(left), np.float32(top)
            reset_scratch(scratch, width - left, height - top)
            _walk(scratch, records, splats, start, stop, corner, limits, rule)
            judge_winners(scratch, rule)
            write_tile(scratch, left, top, (color, alpha, depth), behind, height, width)
            write_winners(scratch, left, top, winner, height, width)
            start, following = following, start
