"""Which splats of a preview touch which 16 × 16 tile, nearest first: `bin` without what only gradients need.

Most splats of a large scene lie within one tile: for them the bounding box is all there is to know. Chunks of splats
write down their pairs one after the other, which are then dealt to the tiles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from jaxtyping import Float32, Int32, Int64
from numpy import ndarray

from instdrive_core.maths.workspace import Workspace
from instdrive_core.rasterize.bin import SLACK, TILE, TILE_BITS, extent, indices
from instdrive_core.rasterize.preview_splats import AT_COV_XX, AT_COV_XY, AT_COV_YY, AT_LIMIT, AT_X, AT_Y

_CHUNKS = 32
"""The result does not depend on it. Near splats touch many more tiles than far ones: threads take what is left."""
_LEAST_ROOM = 1 << 12


@dataclass(frozen=True)
class PreviewTiles:
    """M pairs (tile, splat): tile by tile, row-major; within a tile nearest first. `splats` is the workspace's."""

    columns: int
    starts: Int64[ndarray, " tiles+1"]
    """Tile t owns the pairs starts[t] … starts[t + 1]."""
    splats: Int32[ndarray, " m"]
    """Place among the packed splats."""


def preview_tiles(packed: Float32[ndarray, "v 16"], width: int, height: int, workspace: Workspace) -> PreviewTiles:
    """List for every tile the splats whose ellipse of visible alpha may hold a pixel centre of it."""
    columns, rows = -(-width // TILE), -(-height // TILE)
    size, counts = np.array([width, height, columns], np.int64), np.zeros(_CHUNKS, np.int64)
    room = max(workspace.size("chunk pairs") // (2 * _CHUNKS), _LEAST_ROOM)
    with numba.parallel_chunksize(1):
        while True:
            pairs = workspace.array("chunk pairs", (_CHUNKS, room, 2), np.int32)
            counters = np.zeros((_CHUNKS, columns * rows), np.int32)
            _list_pairs(packed, size, pairs, counts, counters)
            if int(counts.max()) <= room:
                break
            room = int(counts.max())
        starts = np.concatenate([np.zeros(1, np.int64), np.cumsum(counters.sum(axis=0, dtype=np.int64))])
        cursors = starts[:-1] + np.cumsum(counters, axis=0, dtype=np.int64) - counters
        splats = workspace.array("pair splats", (int(starts[-1]),), np.int32)
        _deal_pairs(pairs, counts, cursors, splats)
    return PreviewTiles(columns, starts, splats)


@numba.njit(cache=True, forceinline=True, error_model="numpy")
def _box(packed, v, width, height):
    """First and end column, first and end row of the pixel centres in a splat's bounding box."""
    limit = packed[v, AT_LIMIT]
    reach_x, reach_y = np.sqrt(limit * packed[v, AT_COV_XX]) + SLACK, np.sqrt(limit * packed[v, AT_COV_YY]) + SLACK
    x, y = packed[v, AT_X], packed[v, AT_Y]
    left, right = indices(x - reach_x, x + reach_x, width)
    top, bottom = indices(y - reach_y, y + reach_y, height)
    return left, right, top, bottom


@numba.njit(cache=True, forceinline=True, error_model="numpy")
def _ellipse(packed, v):
    """What `extent` takes: a splat's ellipse of visible alpha, cut in rows of tiles."""
    xx, xy, yy, limit = packed[v, AT_COV_XX], packed[v, AT_COV_XY], packed[v, AT_COV_YY], packed[v, AT_LIMIT]
    return (
        packed[v, AT_X],
        packed[v, AT_Y],
        np.sqrt(limit * yy) + SLACK,
        xy / yy,
        xx - xy * xy / yy,
        limit,
        np.float32(1) / yy,
        xy * np.sqrt(limit / xx),
    )


@numba.njit(cache=True, forceinline=True, error_model="numpy")
def _write_pairs(pairs, counters, chunk, written, room, row_start, first, end, v):
    """Write down a splat's tiles in one row of tiles, as far as there is room."""
    for tile in range(np.uint64(row_start + first), np.uint64(row_start + max(end, first))):
        counters[chunk, tile] += 1
        if written < room:
            pairs[chunk, written, 0], pairs[chunk, written, 1] = tile, v
        written += np.uint64(1)


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def _list_pairs(packed, size, pairs, counts, counters):
    """Write the pairs (tile, splat) of each chunk as far as there is room; `counts` says how many there are."""
    width, height, columns = size[0], size[1], size[2]
    count, room = len(packed), np.uint64(pairs.shape[1])
    for chunk in numba.prange(_CHUNKS):
        written, c = np.uint64(0), np.uint64(chunk)
        for v in range(np.uint64(count * chunk // _CHUNKS), np.uint64(count * (chunk + 1) // _CHUNKS)):
            left, right, top, bottom = _box(packed, v, width, height)
            if left >= right or top >= bottom:
                continue
            upper, lower = top >> TILE_BITS, (bottom - 1) >> TILE_BITS
            first, end = left >> TILE_BITS, (right + TILE - 1) >> TILE_BITS
            if upper == lower and first + 1 == end:
                _write_pairs(pairs, counters, c, written, room, upper * columns, first, end, v)
                written += np.uint64(1)
                continue
            rows = _ellipse(packed, v)
            for row in range(upper, lower + 1):
                left, right = extent(rows, row, width)
                first, end = left >> TILE_BITS, (right + TILE - 1) >> TILE_BITS
                _write_pairs(pairs, counters, c, written, room, row * columns, first, end, v)
                written += np.uint64(max(end - first, 0))
        counts[chunk] = written


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def _deal_pairs(pairs, counts, cursors, splats):
    for chunk in numba.prange(_CHUNKS):
        c = np.uint64(chunk)
        for place in range(np.uint64(counts[chunk])):
            tile = np.uint64(pairs[c, place, 0])
            splats[np.uint64(cursors[c, tile])] = pairs[c, place, 1]
            cursors[c, tile] += 1
