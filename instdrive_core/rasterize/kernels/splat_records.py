"""Records of splats: all that blending reads of one lies side by side, since each cache miss costs a wait."""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from instdrive_core.rasterize.kernels.fragment import FAST, compute_exponent
from instdrive_core.rasterize.kernels.project import DEPTH, Projection
from instdrive_core.rasterize.kernels.settings import RasterSettings

BLOCK = 4
"""Depth and channels are padded with zeros to a multiple of this: kernels treat four of them at once."""
# Columns of a record: the six numbers of `compute_exponent` relative to pixel (0, 0), depth, then the channels.
RECORD_X, RECORD_Y, RECORD_BASE, RECORD_XX, RECORD_XY, RECORD_YY, RECORD_VALUES = (np.uint64(k) for k in range(7))


def pack_records(
    projection: Projection, channels: Float32[ndarray, "n c"], settings: RasterSettings
) -> Float32[ndarray, "v width"]:
    """One record per visible splat, nearest first; columns as named above."""
    width = int(RECORD_VALUES) + count_blocks(1 + channels.shape[1]) * BLOCK
    records = np.empty((len(projection.rows), width), np.float32)
    _pack(projection.splats, projection.rows, channels, settings.to_row(), records)
    return records


def count_blocks(count: int) -> int:
    """Count the blocks that hold `count` numbers."""
    return -(-count // BLOCK)


@numba.njit(cache=True, parallel=True, error_model="numpy", fastmath=FAST)
def _pack(splats, rows, channels, constants, records):
    zero, count = np.float32(0), channels.shape[1]
    for v in numba.prange(len(rows)):
        x, y, base, xx, xy, yy = compute_exponent(splats, v, zero, zero, constants[2])
        records[v, 0], records[v, 1], records[v, 2] = x, y, base
        records[v, 3], records[v, 4], records[v, 5] = xx, xy, yy
        records[v, 6] = splats[v, DEPTH]
        row = rows[v]
        for channel in range(count):
            records[v, 7 + channel] = channels[row, channel]
        for column in range(7 + count, records.shape[1]):
            records[v, column] = zero
