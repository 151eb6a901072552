"""Binning of a preview: which splats touch which 16 × 16 tile, nearest first; no data for gradients.

Most splats of a large scene lie within one row or column of tiles: for them the bounding box is all there is to know.
Chunks of splats write down their pairs one after the other, which are then dealt to the tiles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from jaxtyping import Float32, Int32, Int64
from numpy import ndarray

from instdrive_core.maths.workspace import Workspace
from instdrive_core.rasterize.kernels.bin import SLACK, TILE, TILE_BITS, extent
from instdrive_core.rasterize.preview.splats import AT_COV_XX, AT_COV_XY, AT_COV_YY, AT_LIMIT, AT_X, AT_Y, SPLAT_FLOATS

_CHUNKS = 32
"""The result does not depend on it. Near splats touch many more tiles than far ones: threads take what is left."""
_LEAST_ROOM = 1 << 12
_GROUP = 64
"""Splats whose boxes are worked out at once."""


@dataclass(frozen=True)
class PreviewTiles:
    """M pairs (tile, splat): tile by tile, row-major; within a tile nearest first. `splats` is the workspace's."""

    columns: int
    starts: Int64[ndarray, " tiles+1"]
    """Tile t owns the pairs starts[t] … starts[t + 1]."""
    splats: Int32[ndarray, " m"]
    """Place among the packed splats."""


def bin_preview_splats(packed: Float32[ndarray, "v 16"], width: int, height: int, workspace: Workspace) -> PreviewTiles:
    """List for every tile the splats whose ellipse of visible alpha may hold a pixel centre of it."""
    columns, rows = -(-width // TILE), -(-height // TILE)
    size, counts = np.array([width, height, columns], np.int64), np.zeros(_CHUNKS, np.int64)
    room = max(workspace.get_size("chunk pairs") // (2 * _CHUNKS), _LEAST_ROOM)
    with numba.parallel_chunksize(1):
        while True:
            pairs = workspace.get_array("chunk pairs", (_CHUNKS, room, 2), np.int32)
            counters = np.zeros((_CHUNKS, columns * rows), np.int32)
            _list_pairs(packed, size, pairs, counts, counters)
            if int(counts.max()) <= room:
                break
            room = int(counts.max())
        starts = np.concatenate([np.zeros(1, np.int64), np.cumsum(counters.sum(axis=0, dtype=np.int64))])
        cursors = starts[:-1] + np.cumsum(counters, axis=0, dtype=np.int64) - counters
        splats = workspace.get_array("pair splats", (int(starts[-1]),), np.int32)
        _deal_pairs(pairs, counts, cursors, splats)
    return PreviewTiles(columns, starts, splats)


@numba.njit(cache=True, forceinline=True, error_model="numpy")
def _find_boxes(packed, begin, stop, size, boxes):
    """Write first and end column, first and end row of the tiles that hold the pixel centres in splats' bounding boxes.
    Without branches, so that the loop vectorises: a box without pixel centres ends before it begins."""
    flat, bits, zero = packed.reshape(-1), np.int32(TILE_BITS), np.float32(0)
    last_x, last_y = np.float32(size[0] - 1), np.float32(size[1] - 1)
    for k in range(stop - begin):
        at = (begin + k) * np.uint64(SPLAT_FLOATS)
        limit = max(flat[at + AT_LIMIT], zero)
        reach_x, reach_y = np.sqrt(limit * flat[at + AT_COV_XX]) + SLACK, np.sqrt(limit * flat[at + AT_COV_YY]) + SLACK
        x, y = flat[at + AT_X], flat[at + AT_Y]
        left, top = np.ceil(max(x - reach_x, zero)), np.ceil(max(y - reach_y, zero))
        right, bottom = np.floor(min(x + reach_x, last_x)), np.floor(min(y + reach_y, last_y))
        held = left <= right and top <= bottom
        end = (np.int32(right) >> bits) + np.int32(1)
        boxes[0, k], boxes[1, k] = np.int32(min(left, last_x)) >> bits, end if held else np.int32(0)
        boxes[2, k], boxes[3, k] = np.int32(min(top, last_y)) >> bits, (np.int32(bottom) >> bits) + np.int32(1)


@numba.njit(cache=True, forceinline=True, error_model="numpy")
def _ellipse(packed, v):
    """A splat's ellipse of visible alpha, cut in rows of tiles, as `extent` takes it."""
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
    width, columns = size[0], size[2]
    count, room = len(packed), np.uint64(pairs.shape[1])
    for chunk in numba.prange(_CHUNKS):
        written, c, boxes = np.uint64(0), np.uint64(chunk), np.empty((4, _GROUP), np.int32)
        begin, stop = np.uint64(count * chunk // _CHUNKS), np.uint64(count * (chunk + 1) // _CHUNKS)
        for v in range(begin, stop):
            place = (v - begin) % np.uint64(_GROUP)
            if place == np.uint64(0):
                _find_boxes(packed, v, min(v + np.uint64(_GROUP), stop), size, boxes)
            first, end = np.int64(boxes[0, place]), np.int64(boxes[1, place])
            upper, lower = np.int64(boxes[2, place]), np.int64(boxes[3, place])
            if end - first <= 1 or lower - upper <= 1:
                for row in range(upper, lower):
                    _write_pairs(pairs, counters, c, written, room, row * columns, first, end, v)
                    written += np.uint64(max(end - first, 0))
                continue
            rows = _ellipse(packed, v)
            for row in range(upper, lower):
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
