"""Binning: which splats touch which 16 × 16 tile, by a counting sort over splats that are already in depth order.

Pairs are counted by one kernel and placed by another, which must agree on every bound to the last bit: a pair that was
counted and not placed would name a splat at random. So nothing here is compiled with fastmath, with which the compiler
may round the same formula differently in two places.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from jaxtyping import Int32, Int64, UInt8
from numpy import ndarray

from instdrive_core.rasterize.kernels.project import MEAN_X, POWER_LIMIT, Projection

TILE = 16
PIXELS = TILE * TILE
TILE_BITS = 4
_CHUNKS = 16
"""Splats are dealt to this many parallel counters; the result does not depend on it."""
SLACK = np.float32(1e-3)
"""Pixels added around an ellipse so that rounding never loses a fragment that the alpha test would keep."""


@dataclass(frozen=True)
class TileLists:
    """M pairs (tile, splat): tile by tile, row-major; within a tile nearest first."""

    columns: int
    rows: int
    starts: Int64[ndarray, " tiles+1"]
    """Tile t owns the pairs starts[t] … starts[t + 1]."""
    splats: Int32[ndarray, " m"]
    """Index into the projection."""
    spans: UInt8[ndarray, "m 2"]
    """First row and end row of the tile that the splat reaches."""
    entries: Int32[ndarray, " m"]
    """Place of each pair when they are ordered splat by splat, each splat's in tile order."""
    splat_starts: Int64[ndarray, " v+1"]
    """Splat v owns the entries splat_starts[v] … splat_starts[v + 1]."""


def bin_splats(projection: Projection, width: int, height: int) -> TileLists:
    """List for every tile the splats with a pixel centre inside their ellipse of visible alpha."""
    columns, rows = -(-width // TILE), -(-height // TILE)
    size = np.array([width, height, columns, rows], np.int64)
    count = len(projection.rows)
    counters = np.zeros((_CHUNKS, columns * rows), np.int64)
    splat_counts = np.zeros(count, np.int64)
    _count_pairs(projection.splats, projection.covariances, size, counters, splat_counts)
    splat_starts = np.concatenate([np.zeros(1, np.int64), np.cumsum(splat_counts)])
    totals = counters.sum(axis=0)
    starts = np.concatenate([np.zeros(1, np.int64), np.cumsum(totals)])
    cursors = starts[:-1] + np.cumsum(counters, axis=0) - counters
    total = int(starts[-1])
    splats, spans, entries = np.empty(total, np.int32), np.empty((total, 2), np.uint8), np.empty(total, np.int32)
    _place_pairs(projection.splats, projection.covariances, size, cursors, splat_starts, splats, spans, entries)
    return TileLists(columns, rows, starts, splats, spans, entries, splat_starts)


@numba.njit(cache=True, forceinline=True, error_model="numpy")
def _ellipse(splats, covariances, v, axis):
    """A splat's ellipse of visible alpha, cut in bands across `axis` (0 = x, 1 = y).

    Returns: centre along the other axis and along `axis`, in pixel indices; half extent along `axis`; then what
    `extent` takes: slope and stretch, the limit, one over the variance along `axis`, and where along `axis` the
    ellipse is farthest out along the other.
    """
    xx, xy, yy = covariances[v, 0], covariances[v, 1], covariances[v, 2]
    across, along = (yy, xx) if axis == 0 else (xx, yy)
    limit = splats[v, POWER_LIMIT]
    return (
        splats[v, MEAN_X + 1 - axis] - np.float32(0.5),
        splats[v, MEAN_X + axis] - np.float32(0.5),
        np.sqrt(limit * along) + SLACK,
        xy / along,
        across - xy * xy / along,
        limit,
        np.float32(1) / along,
        xy * np.sqrt(limit / across),
    )


@numba.njit(cache=True, forceinline=True, error_model="numpy")
def indices(low, high, size):
    """First index and end index of the pixel centres in [low, high], within 0 … size; none between bounds that are no
    numbers."""
    if not low <= high:
        return np.int64(0), np.int64(0)
    first = min(max(np.ceil(low), np.float32(0)), np.float32(size))
    last = max(min(np.floor(high), np.float32(size - 1)), np.float32(-1))
    return np.int64(np.int32(first)), np.int64(np.int32(last)) + 1


@numba.njit(cache=True, forceinline=True, error_model="numpy")
def extent(ellipse, band, size):
    """First and end pixel index of an ellipse within tile band `band`, along the other axis."""
    center, band_center, reach, slope, stretch, limit, inverse_variance, peak = ellipse
    low = max(np.float32(band * TILE) - band_center, -reach)
    high = min(np.float32(band * TILE + TILE - 1) - band_center, reach)
    right, left = min(max(peak, low), high), min(max(-peak, low), high)
    half_right = np.sqrt(max(stretch * (limit - right * right * inverse_variance), np.float32(0))) + SLACK
    half_left = np.sqrt(max(stretch * (limit - left * left * inverse_variance), np.float32(0))) + SLACK
    return indices(center + slope * left - half_left, center + slope * right + half_right, size)


@numba.njit(cache=True, parallel=True, error_model="numpy")
def _count_pairs(splats, covariances, size, counters, splat_counts):
    width, height, columns = size[0], size[1], size[2]
    count = len(splats)
    for chunk in numba.prange(_CHUNKS):
        for v in range(count * chunk // _CHUNKS, count * (chunk + 1) // _CHUNKS):
            rows = _ellipse(splats, covariances, v, 1)
            top, bottom = indices(rows[1] - rows[2], rows[1] + rows[2], height)
            for row in range(top >> TILE_BITS, (bottom + TILE - 1) >> TILE_BITS):
                left, right = extent(rows, row, width)
                for column in range(left >> TILE_BITS, (right + TILE - 1) >> TILE_BITS):
                    counters[chunk, row * columns + column] += 1
                    splat_counts[v] += 1


@numba.njit(cache=True, parallel=True, error_model="numpy")
def _place_pairs(splats, covariances, size, cursors, splat_starts, out_splats, out_spans, out_entries):
    width, height, columns = size[0], size[1], size[2]
    count = len(splats)
    for chunk in numba.prange(_CHUNKS):
        for v in range(count * chunk // _CHUNKS, count * (chunk + 1) // _CHUNKS):
            entry = splat_starts[v]
            rows, across = _ellipse(splats, covariances, v, 1), _ellipse(splats, covariances, v, 0)
            top, bottom = indices(rows[1] - rows[2], rows[1] + rows[2], height)
            for row in range(top >> TILE_BITS, (bottom + TILE - 1) >> TILE_BITS):
                left, right = extent(rows, row, width)
                for column in range(left >> TILE_BITS, (right + TILE - 1) >> TILE_BITS):
                    first, end = extent(across, column, height)
                    place = cursors[chunk, row * columns + column]
                    cursors[chunk, row * columns + column] += 1
                    out_splats[place], out_entries[place] = v, entry
                    out_spans[place, 0] = min(max(first - row * TILE, 0), TILE)
                    out_spans[place, 1] = max(min(end - row * TILE, TILE), out_spans[place, 0])
                    entry += 1
