"""The end of a preview's tile: its pictures are written, and its winners judged."""

from __future__ import annotations

import numba
import numpy as np

from instdrive_core.rasterize.kernels.fragment import FAST
from instdrive_core.rasterize.kernels.lane_shuffles import arrange_rows, interleave_lanes, store_up_to, take_member
from instdrive_core.rasterize.kernels.simd import (
    build_block,
    choose,
    fill_lanes,
    load,
    load_block,
    pack_lane_bits,
    prefetch_to_write,
    store,
    store_block,
    unpack_lane_bits,
)
from instdrive_core.rasterize.preview.scratch import (
    BLOCKS,
    FIRST_LIGHT,
    LANES,
    SECOND_LIGHT,
    SECOND_ROW,
    SIDE,
    STRIDE,
    TRANSMITTANCE,
    VALUES,
    WINNER,
)


@numba.njit(cache=True, forceinline=True, error_model="numpy")
def fetch_pictures(left, top, pictures, winner, height, width):
    """Have a tile's part of the pictures fetched while it is blended: lines written at the end are then at hand."""
    color, alpha, depth = pictures
    for line in range(min(LANES, height - top)):
        last = (top + line) * width + min(left + LANES, width) - np.uint64(1)  # the first may be the tile before's
        prefetch_to_write(alpha, last)
        prefetch_to_write(depth, last)
        prefetch_to_write(winner, last)
        for part in range(np.uint64(3)):
            prefetch_to_write(color, last * np.uint64(3) + np.uint64(2) - part * LANES)


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=FAST)
def write_tile(scratch, left, top, pictures, behind, height, width):
    """Copy a blended tile into colour, alpha and depth; what shows through is of the colour `behind`."""
    planes, (color, alpha, depth) = scratch.planes, pictures
    zero, one, three = np.float32(0), np.float32(1), np.uint64(3)
    _lay_in_rows(planes, TRANSMITTANCE)
    for channel in range(np.uint64(4)):
        _lay_in_rows(planes, VALUES + channel * STRIDE)
    across = np.int64(width - left)
    for line in range(min(LANES, height - top)):
        at, pixel = line * LANES, (top + line) * width + left
        through = load(planes, TRANSMITTANCE + at)
        total = one - through
        store_up_to(across, alpha, pixel, total)
        store_up_to(across, depth, pixel, choose(total > zero, load(planes, VALUES + at) / total, zero))
        first = VALUES + STRIDE + at
        red = load(planes, first) + through * behind[0]
        green = load(planes, first + STRIDE) + through * behind[1]
        blue = load(planes, first + STRIDE + STRIDE) + through * behind[2]
        parts = interleave_lanes(build_block(red, green, blue))
        store_up_to(3 * across, color, three * pixel, take_member(parts, 0))
        store_up_to(3 * across - 16, color, three * pixel + LANES, take_member(parts, 1))
        store_up_to(3 * across - 32, color, three * pixel + LANES + LANES, take_member(parts, 2))


@numba.njit(cache=True, forceinline=True, error_model="numpy", fastmath=FAST)
def judge_winners(scratch, rule):
    """Judge which of the two instances that were counted has a pixel, before `write_tile`."""
    planes = scratch.planes
    bits, zero, one = planes.view(np.int32), np.float32(0), np.float32(1)
    for block in range(BLOCKS):
        at = block * LANES
        light, other_light = load(planes, FIRST_LIGHT + at), load(planes, SECOND_LIGHT + at)
        winner = choose(light >= other_light, load(planes, WINNER + at), load(planes, SECOND_ROW + at))
        store(planes, WINNER + at, winner)
        faint = (fill_lanes(rule[2]) > one - load(planes, TRANSMITTANCE + at)) & (light + other_light > zero)
        bare = pack_lane_bits(unpack_lane_bits(scratch.unclaimed[block]) & faint)
        for lane in range(LANES if bare != np.uint16(0) else np.uint64(0)):
            if (bare >> np.uint16(lane)) & np.uint16(1):
                bits[WINNER + at + lane] = np.int32(-1)


@numba.njit(cache=True, forceinline=True, error_model="numpy")
def write_winners(scratch, left, top, winner, height, width):
    """Copy a judged tile's winners; `winner` holds rows, as the bits of an int32."""
    planes = scratch.planes
    _lay_in_rows(planes, WINNER)
    for line in range(min(LANES, height - top)):
        row = load(planes, WINNER + line * LANES)
        store_up_to(np.int64(width - left), winner, (top + line) * width + left, row)


@numba.njit(cache=True, forceinline=True, error_model="numpy")
def _lay_in_rows(planes, plane):
    """From blocks of 4 × 4 to rows of 16 pixels, in place."""
    for four in range(SIDE):
        at = plane + four * SIDE * LANES
        store_block(planes, at, LANES, arrange_rows(load_block(4, planes, at, LANES)))
