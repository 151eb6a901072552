"""A chunk of rows while it is projected and coloured: small enough for the caches, sixteen rows side by side."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from jaxtyping import Float32, UInt64
from numpy import ndarray

from instdrive_core.rasterize.kernels.blend import allocate_aligned_zeros
from instdrive_core.rasterize.kernels.simd import WIDTH
from instdrive_core.rasterize.preview.splats import SPLAT_FLOATS

CHUNK = 128
"""Rows of a chunk."""
COLUMNS, BOXES = np.uint64(SPLAT_FLOATS * WIDTH), np.uint64(2 * WIDTH)
"""Floats of a group of sixteen rows: columns of lines, and the bits of their tiles."""


class Chunk(NamedTuple):
    """One task's memory: 8 groups of sixteen rows."""

    columns: Float32[ndarray, " 8*256"]
    """Group by group, for each column of a line sixteen numbers."""
    boxes: Float32[ndarray, " 8*32"]
    """Group by group the rows of `ProjectedSplats.tiles`, as bits."""
    seen: UInt64[ndarray, " 8"]
    """The visible rows of each group, a bit each."""
    fresh: UInt64[ndarray, " 8"]
    """Those of them whose colours are computed now."""
    directions: Float32[ndarray, " 3*128"]
    """Offsets from the camera, then unit vectors: x of all rows, y, z."""
    basis: Float32[ndarray, "k 128"]
    """Values of k harmonics above the constant."""
    places: UInt64[ndarray, " 16"]
    """Where the harmonics of a group's rows begin."""


@numba.njit(cache=True, error_model="numpy")
def new_chunk(values):
    """Make memory for chunks, one after the other, with `values` harmonics above the constant."""
    groups = CHUNK // WIDTH
    return Chunk(
        allocate_aligned_zeros(groups * np.int64(COLUMNS)),
        allocate_aligned_zeros(groups * np.int64(BOXES)),
        np.zeros(groups, np.uint64),
        np.zeros(groups, np.uint64),
        allocate_aligned_zeros(3 * CHUNK),
        np.empty((values, CHUNK), np.float32),
        np.empty(WIDTH, np.uint64),
    )
