"""A tile of a preview while it is blended: what is kept per pixel, and the splats that are staged for it.

A tile is sixteen blocks of 4 × 4 pixels, each as wide as a register: fewer blocks than rows of sixteen are reached by
a splat of a few pixels. One flat float32 array holds everything that is per pixel, in planes, block by block.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from jaxtyping import Float32, UInt16
from numpy import ndarray

from instdrive_core.rasterize.kernels.bin import PIXELS, TILE
from instdrive_core.rasterize.kernels.blend import allocate_aligned_zeros
from instdrive_core.rasterize.kernels.simd import fill_lanes, load, pack_lane_bits

SIDE, BLOCKS, LANES = np.uint64(4), np.uint64(16), np.uint64(16)
BATCH = 64
"""Splats staged at once, one bit of a uint64 each; after each batch a finished tile is left."""
STRIDE = np.uint64(PIXELS + TILE)
"""Planes lie one line apart, so that they do not fall on the same cache sets."""
# Winners are rows, as the bits of an int32; -1 for none.
_PLANES = tuple(STRIDE * np.uint64(plane) for plane in range(15))
TRANSMITTANCE, VALUES = _PLANES[0], _PLANES[9]
# Of two instances: which one, its light so far, its heaviest splat (the first one's place is the winner's in the end),
# and the light of that.
FIRST, FIRST_LIGHT, WINNER, FIRST_WEIGHT, SECOND, SECOND_LIGHT, SECOND_ROW, SECOND_WEIGHT = _PLANES[1:9]
COLUMN, LINE = _PLANES[13:]
NOBODY = np.float32(-1)
"""No instance has this number."""


class Scratch(NamedTuple):
    """One task's memory. Bits of blocks: one uint16 each, a bit per pixel."""

    planes: Float32[ndarray, " 15*272"]
    centers: Float32[ndarray, " 32"]
    """Column of each block's centre, line of each."""
    open: UInt16[ndarray, " 16"]
    """Pixels that still let light through."""
    undecided: UInt16[ndarray, " 16"]
    """Pixels of which splats behind may still change the winner."""
    unclaimed: UInt16[ndarray, " 16"]
    """Pixels that no solid splat has claimed."""
    staged: Float32[ndarray, " 64*16"]
    """A cache line per splat."""
    blocks: UInt16[ndarray, " 64"]
    """Blocks that each staged splat reaches, a bit per block."""


@numba.njit(cache=True, error_model="numpy")
def new_scratch():
    """Make memory for tiles, one after the other."""
    planes, centers = allocate_aligned_zeros(np.int64(LINE + STRIDE)), allocate_aligned_zeros(2 * np.int64(BLOCKS))
    for block in range(16):
        centers[block], centers[16 + block] = block % 4 * 4 + 1.5, block // 4 * 4 + 1.5
        for lane in range(16):
            place = block * 16 + lane
            planes[np.int64(COLUMN) + place] = block % 4 * 4 + lane % 4
            planes[np.int64(LINE) + place] = block // 4 * 4 + lane // 4
    bits = np.zeros((3, 16), np.uint16)
    staged, blocks = allocate_aligned_zeros(BATCH * np.int64(LANES)), np.zeros(BATCH, np.uint16)
    return Scratch(planes, centers, bits[0], bits[1], bits[2], staged, blocks)


@numba.njit(cache=True, forceinline=True, error_model="numpy")
def reset_scratch(scratch, width, height):
    """Start a tile with nothing blended; `width` and `height` reach from its corner to the image's."""
    planes, none = scratch.planes, np.int32(-1)
    for q in range(np.uint64(PIXELS)):
        planes[TRANSMITTANCE + q] = np.float32(1)
    for q in range(FIRST, COLUMN):
        planes[q] = np.float32(0)
    bits = planes.view(np.int32)
    for q in range(np.uint64(PIXELS)):
        planes[FIRST + q], planes[SECOND + q] = NOBODY, NOBODY
        bits[WINNER + q], bits[SECOND_ROW + q] = none, none
    width, height = fill_lanes(np.float32(width)), fill_lanes(np.float32(height))
    for block in range(BLOCKS):
        at = block * LANES
        inside = pack_lane_bits((width > load(planes, COLUMN + at)) & (height > load(planes, LINE + at)))
        scratch.open[block], scratch.undecided[block], scratch.unclaimed[block] = inside, inside, inside
