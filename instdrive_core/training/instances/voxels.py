"""Gaussians grouped by the voxel they lie in: in time proportional to their number, without sorting."""

from __future__ import annotations

from dataclasses import dataclass
from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Float, Float32, Float64, Int64, UInt16
from numpy import ndarray

from instdrive_core.rasterize.kernels.layout import to_kernel_array

_CHUNK = 1 << 13
"""Rows that one thread takes at a time."""
_BUCKET = 1 << 11
"""Rows of a bucket, about: its table of voxels stays in a core's own cache."""
_HASH = np.uint64(0x9E3779B97F4A7C15)
"""2⁶⁴ over the golden ratio: Knuth's multiplicative hashing."""


@dataclass(frozen=True)
class Voxels:
    """Gaussians voxel by voxel: those of voxel v are `order[starts[v]:starts[v + 1]]`, rising."""

    order: Int64[ndarray, " n"]
    starts: Int64[ndarray, " v1"]


def group_by_voxel(
    positions: Float[ndarray, "n 3"], nodes: UInt16[ndarray, " n"], size: float, offset: Float[ndarray, "3"]
) -> Voxels:
    """Group Gaussians by the voxel of their own node's frame; `offset` (metres) shifts the grid of cells of `size`.

    Rows are dealt to buckets by a hash of their voxel, then each bucket is grouped by one thread. The order of the
    voxels depends on the positions alone, not on the number of threads.
    """
    count = len(positions)
    if not count:
        return Voxels(np.zeros(0, np.int64), np.zeros(1, np.int64))
    positions, nodes = to_kernel_array(positions), np.require(nodes, np.uint16, ["C", "W"])
    chunks, bits = -(-count // _CHUNK), max(0, (count // _BUCKET).bit_length())
    grid = _grid(positions, size, offset, chunks)
    keys, places = np.empty(count, np.int64), np.zeros((chunks, 1 << bits), np.int64)
    _count_buckets(positions, nodes, grid, bits, keys, places)
    ends = np.cumsum(places.T.ravel())
    places = np.ascontiguousarray((ends - places.T.ravel()).reshape(places.shape[::-1]).T)
    bounds = np.append(places[0], count)

    rows, dealt = np.empty(count, np.int32), np.empty(count, np.int64)
    _deal(keys, bits, places, rows, dealt)
    order, firsts = np.empty(count, np.int64), np.empty(count, np.int64)
    found = np.zeros(len(bounds), np.int64)
    _group_buckets(rows, dealt, bounds, order, firsts, found)
    numbers = np.cumsum(found)
    starts = np.empty(numbers[-1] + 1, np.int64)
    starts[-1] = count
    _join(firsts, bounds, numbers, starts)
    return Voxels(order, starts)


def _grid(positions: Float32[ndarray, "n 3"], size: float, offset: ndarray, chunks: int) -> Float64[ndarray, "3 3"]:
    """Rows: what to add to positions, by what to divide them (first column); the lowest cell; cells per axis."""
    lowest, highest = np.empty((chunks, 3), np.float32), np.empty((chunks, 3), np.float32)
    _extremes(positions, lowest, highest)
    first = np.floor((lowest.min(axis=0) + offset) / size)
    last = np.floor((highest.max(axis=0) + offset) / size)
    return np.stack([np.asarray(offset, np.float64), first, last - first + 1, np.full(3, size)])


@numba.njit(parallel=True, cache=True, error_model="numpy")
@no_type_check
def _extremes(positions, lowest, highest):
    for chunk in numba.prange(len(lowest)):
        for axis in range(3):
            low = high = positions[chunk * _CHUNK, axis]
            for row in range(chunk * _CHUNK, min(len(positions), (chunk + 1) * _CHUNK)):
                low, high = min(low, positions[row, axis]), max(high, positions[row, axis])
            lowest[chunk, axis], highest[chunk, axis] = low, high


@numba.njit(cache=True)
@no_type_check
def _find_bucket(key, bits):
    return (np.uint64(key) * _HASH) >> np.uint64(48) >> np.uint64(16 - bits)


@numba.njit(parallel=True, cache=True, error_model="numpy")
@no_type_check
def _count_buckets(positions, nodes, grid, bits, keys, counts):
    """Each row's voxel as one number, and how many rows of each chunk belong to each bucket."""
    size = grid[3, 0]
    width, depth, height = np.int64(grid[2, 0]), np.int64(grid[2, 1]), np.int64(grid[2, 2])
    for chunk in numba.prange(len(counts)):
        for row in range(chunk * _CHUNK, min(len(positions), (chunk + 1) * _CHUNK)):
            x = np.int64(np.floor((positions[row, 0] + grid[0, 0]) / size) - grid[1, 0])
            y = np.int64(np.floor((positions[row, 1] + grid[0, 1]) / size) - grid[1, 1])
            z = np.int64(np.floor((positions[row, 2] + grid[0, 2]) / size) - grid[1, 2])
            key = ((nodes[row] * width + x) * depth + y) * height + z
            keys[row] = key
            counts[chunk, _find_bucket(key, bits)] += 1


@numba.njit(parallel=True, cache=True)
@no_type_check
def _deal(keys, bits, places, rows, dealt):
    """Rows and their voxels bucket by bucket; each chunk has its own places in each bucket."""
    for chunk in numba.prange(len(places)):
        for row in range(chunk * _CHUNK, min(len(keys), (chunk + 1) * _CHUNK)):
            key = keys[row]
            bucket = _find_bucket(key, bits)
            place = places[chunk, bucket]
            rows[place], dealt[place] = row, key
            places[chunk, bucket] = place + 1


@numba.njit(parallel=True, cache=True)
@no_type_check
def _group_buckets(rows, keys, bounds, order, firsts, found):
    """Group each bucket's rows by voxel, in the order of their first rows; `firsts` holds where each voxel starts."""
    for bucket in numba.prange(len(bounds) - 1):
        found[bucket + 1] = _group(rows, keys, bounds[bucket], bounds[bucket + 1], order, firsts)


@numba.njit(cache=True)
@no_type_check
def _group(rows, keys, start, stop, order, firsts):
    bits = 1
    while (1 << bits) < 2 * (stop - start):
        bits += 1
    slots, mask = np.full(1 << bits, -1, np.int32), (1 << bits) - 1
    voxel_of, owners = np.empty(stop - start, np.int32), np.empty(stop - start, np.int64)
    sizes, voxels = np.zeros(stop - start + 1, np.int64), 0
    for k in range(start, stop):
        # Other bits of the hash than those that chose the bucket.
        slot = np.int64((np.uint64(keys[k]) * _HASH) >> np.uint64(20)) & mask
        while slots[slot] >= 0 and owners[slots[slot]] != keys[k]:
            slot = (slot + 1) & mask
        if slots[slot] < 0:
            slots[slot], owners[voxels] = voxels, keys[k]
            voxels += 1
        voxel_of[k - start] = slots[slot]
        sizes[slots[slot]] += 1
    place = start
    for v in range(voxels):
        firsts[start + v] = place
        place, sizes[v] = place + sizes[v], place
    for k in range(start, stop):
        v = voxel_of[k - start]
        order[sizes[v]] = rows[k]
        sizes[v] += 1
    return voxels


@numba.njit(parallel=True, cache=True)
@no_type_check
def _join(firsts, bounds, numbers, starts):
    for bucket in numba.prange(len(bounds) - 1):
        for v in range(numbers[bucket + 1] - numbers[bucket]):
            starts[numbers[bucket] + v] = firsts[bounds[bucket] + v]
