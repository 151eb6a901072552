"""Binning of a preview: which splats touch which 16 × 16 tile; no data for gradients.

Most splats of a large scene touch at most four tiles: which ones was found out while they were projected. Chunks of
splats write down their pairs one after the other, which are then dealt to the tiles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from jaxtyping import Int64, UInt64
from numpy import ndarray

from instdrive_core.maths.workspace import Workspace
from instdrive_core.rasterize.kernels.bin import SLACK, TILE, TILE_BITS, indices
from instdrive_core.rasterize.kernels.fragment import EIGHTH
from instdrive_core.rasterize.kernels.lane_math import round_down, round_up, take_root
from instdrive_core.rasterize.kernels.simd import WIDTH, choose, greatest, least, load, prefetch, store
from instdrive_core.rasterize.preview.splats import (
    AT_C,
    AT_COV_XX,
    AT_COV_XY,
    AT_LIMIT,
    AT_X,
    AT_Y,
    MANY,
    SPLAT_FLOATS,
    ProjectedSplats,
)
from instdrive_core.rasterize.preview.tile_order import KEY

_CHUNKS = 32
"""The result does not depend on it. Near splats touch many more tiles than far ones: threads take what is left."""
_AHEAD = np.uint64(24)
"""So many splats ahead the lines of those of many tiles are fetched."""
_LEAST_ROOM, _FEW_TILES = 1 << 12, 4
_SIDE, _ROW, _BITS, _MANY = np.uint64(0xFFFF), np.uint64(16), np.uint64(32), np.uint64(MANY)
"""Where in a record of `ProjectedSplats.tiles` the row and the bits are."""
_NUMBERS, _UPPER = np.uint64(WIDTH), np.uint64(2 * WIDTH)
"""In what `_cut_rows` writes: where the numbers of tiles begin, and behind them the first line of each of its rows."""
_SPLAT, _TILE = np.uint64(32), np.uint64(0xFFFFFFFF)
"""A pair is the number of the tile and, beyond these bits, the splat."""


@dataclass(frozen=True)
class PreviewTiles:
    """M pairs (tile, splat): tile by tile, row-major; within a tile in the order of rows."""

    columns: int
    starts: Int64[ndarray, " tiles+1"]
    """Tile t owns the pairs starts[t] … starts[t + 1]."""
    entries: UInt64[ndarray, " m"]
    """What `order_tile` sorts; the workspace's."""


def bin_preview_splats(found: ProjectedSplats, width: int, height: int, workspace: Workspace) -> PreviewTiles:
    """List for every tile the splats whose ellipse of visible alpha may hold a pixel centre of it."""
    columns, rows = -(-width // TILE), -(-height // TILE)
    size, counts = np.array([width, height, columns], np.int64), np.zeros(_CHUNKS, np.int64)
    room = max(workspace.get_size("chunk pairs") // _CHUNKS, _LEAST_ROOM)
    with numba.parallel_chunksize(1):
        while True:
            pairs = workspace.get_array("chunk pairs", (_CHUNKS, room), np.uint64)
            counters = np.zeros((_CHUNKS, columns * rows), np.int32)
            _list_pairs(found.tiles.view(np.uint64).reshape(-1), found.lines.reshape(-1), size, pairs, counts, counters)
            if int(counts.max()) <= room:
                break
            room = int(counts.max()) + _FEW_TILES
        starts = np.concatenate([np.zeros(1, np.int64), np.cumsum(counters.sum(axis=0, dtype=np.int64))])
        cursors = starts[:-1] + np.cumsum(counters, axis=0, dtype=np.int64) - counters
        entries = workspace.get_array("tile entries", (int(starts[-1]),), np.uint64)
        _deal_pairs(pairs, counts, found.depths.view(np.uint32), cursors, entries)
    return PreviewTiles(columns, starts, entries)


@numba.njit(cache=True, forceinline=True, error_model="numpy")
def _compute_height(flat, at):
    """Compute the vertical part of a splat's 2D covariance, of which c is made."""
    return np.float32(0.5) * EIGHTH / (flat[at + AT_C] * flat[at + AT_C])


@numba.njit(cache=True, forceinline=True, error_model="numpy")
def _cut_rows(flat, at, row, width, tiles):
    """Cut a splat's ellipse of visible alpha in sixteen rows of tiles from `row` on: the first tile of each that it
    reaches, then how many there are. Undefined for rows that it does not reach."""
    x, y, limit, zero = flat[at + AT_X], flat[at + AT_Y], flat[at + AT_LIMIT], np.float32(0)
    xx, xy, yy = flat[at + AT_COV_XX], flat[at + AT_COV_XY], _compute_height(flat, at)
    slope, stretch, inverse, reach = xy / yy, xx - xy * xy / yy, np.float32(1) / yy, np.sqrt(limit * yy) + SLACK
    peak = xy * np.sqrt(limit / xx)
    upper = load(tiles, _UPPER) + (np.float32(row * np.uint64(TILE)) - y)
    low, high = greatest(upper, zero - reach), least(upper + np.float32(TILE - 1), reach)
    left, right = least(greatest(low, zero - peak), high), least(greatest(low, peak), high)
    half_left = take_root(greatest(stretch * (limit - left * left * inverse), zero)) + SLACK
    half_right = take_root(greatest(stretch * (limit - right * right * inverse), zero)) + SLACK
    first = round_up(greatest(slope * left - half_left + x, zero))
    last = round_down(least(slope * right + half_right + x, width - np.float32(1)))
    start = round_down(first * np.float32(1 / TILE))
    store(tiles, np.uint64(0), start)
    store(tiles, _NUMBERS, choose(last >= first, round_down(last * np.float32(1 / TILE)) - start + np.float32(1), zero))


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def _list_pairs(records, flat, size, pairs, counts, counters):
    """Write the pairs (tile, splat) of each chunk as far as there is room; `counts` says how many there are.

    All in one function: each that is called for every splat would count references to its arrays, which takes longer
    than listing. And without branches for splats of few tiles, whose number nothing foretells.
    """
    count, width, columns, room = np.uint64(len(records)), size[0], np.uint64(size[2]), np.uint64(pairs.shape[1])
    one, two = np.uint64(1), np.uint64(2)
    for chunk in numba.prange(_CHUNKS):
        c, written, tiles = np.uint64(chunk), np.uint64(0), np.empty(3 * WIDTH, np.float32)
        for place in range(WIDTH):
            tiles[np.int64(_UPPER) + place] = np.float32(place * TILE)
        begin, stop = count * c // np.uint64(_CHUNKS), count * (c + one) // np.uint64(_CHUNKS)
        for splat in range(begin, stop):
            soon = min(splat + _AHEAD, stop - one)
            if records[soon] >> _BITS == _MANY:
                prefetch(flat, soon * np.uint64(SPLAT_FLOATS))
            record, pair = records[splat], splat << _SPLAT
            bits = record >> _BITS
            if bits < _MANY and written + np.uint64(_FEW_TILES) <= room:
                first = (record & _SIDE) + ((record >> _ROW) & _SIDE) * columns
                pairs[c, written] = pair | first
                written += bits & one
                pairs[c, written] = pair | (first + one)
                written += (bits >> one) & one
                pairs[c, written] = pair | (first + columns)
                written += (bits >> two) & one
                pairs[c, written] = pair | (first + columns + one)
                written += bits >> np.uint64(3)
                continue
            if bits == np.uint64(0):
                continue
            at = splat * np.uint64(SPLAT_FLOATS)
            y, reach = flat[at + AT_Y], np.sqrt(flat[at + AT_LIMIT] * _compute_height(flat, at)) + SLACK
            upper, lower = indices(y - reach, y + reach, size[1])
            top, bottom = np.uint64(upper >> TILE_BITS), np.uint64((lower + TILE - 1) >> TILE_BITS)
            for row in range(top, bottom):
                k = (row - top) % np.uint64(WIDTH)
                if k == np.uint64(0):
                    _cut_rows(flat, at, row, np.float32(width), tiles)
                first, number = row * columns + np.uint64(tiles[k]), np.uint64(tiles[_NUMBERS + k])
                begun = written + np.uint64(_FEW_TILES) <= room
                if begun:  # most rows have no more, and how many they have, nothing foretells
                    pairs[c, written] = pair | first
                    pairs[c, written + one] = pair | (first + one)
                    pairs[c, written + two] = pair | (first + two)
                    pairs[c, written + two + one] = pair | (first + two + one)
                for place in range(np.uint64(_FEW_TILES) if begun else np.uint64(0), number):
                    if written + place < room:
                        pairs[c, written + place] = pair | (first + place)
                written += number
        counts[chunk] = written
        for place in range(min(written, room)):
            counters[c, pairs[c, place] & _TILE] += 1


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def _deal_pairs(pairs, counts, keys, cursors, entries):
    for chunk in numba.prange(_CHUNKS):
        c = np.uint64(chunk)
        for place in range(np.uint64(counts[chunk])):
            pair = pairs[c, place]
            tile, splat = pair & _TILE, pair >> _SPLAT
            entries[np.uint64(cursors[c, tile])] = (np.uint64(keys[splat]) << KEY) | splat
            cursors[c, tile] += 1
