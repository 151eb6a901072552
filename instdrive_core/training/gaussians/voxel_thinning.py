"""One point per voxel, with voxels that grow with the distance from the drive."""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float32, Int64
from numpy import ndarray
from scipy.spatial import KDTree

_FULL_DETAIL = 4.0
"""Metres from the path of the cameras up to which voxels have their smallest size."""
_SMALLEST, _LARGEST = 0.005, 2.0
"""Metres: sizes at the path between which the one that fits is looked for."""
_CLOSE_ENOUGH = 0.97


def thin_by_voxels(
    positions: Float32[ndarray, "n 3"], centers: Float32[ndarray, "c 3"], limit: int, rng: np.random.Generator
) -> Int64[ndarray, " k"]:
    """Choose the rows of at most `limit` points, one per voxel, rising.

    Voxels double in size with each doubling of the distance to the nearest of `centers`, in half steps; which point
    of a voxel stays is random.
    """
    if len(positions) <= limit:
        return np.arange(len(positions))
    distances, _ = KDTree(centers).query(positions, workers=numba.get_num_threads())
    level = np.floor(np.log2(np.maximum(distances, _FULL_DETAIL) / _FULL_DETAIL) * 2) / 2
    growth = (2**level).astype(np.float32)
    order = rng.permutation(len(positions))
    low, high = _SMALLEST, _LARGEST
    size, kept = np.sqrt(low * high), order[:limit]
    for _ in range(12):
        first = _first_of_voxels(positions, growth, order, size)
        if len(first) > limit:
            low = size
        else:
            high, kept = size, first
            if len(first) > _CLOSE_ENOUGH * limit:
                break
        guess = size * np.sqrt(len(first) / (0.985 * limit))  # points lie on surfaces: their voxels go with size⁻²
        size = guess if low < guess < high else np.sqrt(low * high)
    return np.sort(kept)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _first_of_voxels(
    positions: Float32[ndarray, "n 3"], growth: Float32[ndarray, " n"], order: Int64[ndarray, " n"], size: float
) -> Int64[ndarray, " k"]:
    """Rows, in the given order, of the first point of each voxel of `size` · growth metres."""
    slots = 1
    while slots < 2 * len(order):
        slots *= 2
    free, one, last_slot = np.uint64(0), np.uint64(1), np.uint64(slots - 1)
    taken = np.zeros(slots, np.uint64)  # open addressing; two voxels whose 64-bit keys agree are taken for one
    rows, count = np.empty(len(order), np.int64), 0
    for row in order:
        side = size * growth[row]
        key = np.uint64(0x9E3779B97F4A7C15) ^ np.uint64(np.int64(growth[row] * 16))
        for axis in range(3):
            key ^= np.uint64(np.int64(np.floor(positions[row, axis] / side)))
            key *= np.uint64(0xBF58476D1CE4E5B9)
            key ^= key >> np.uint64(31)
        key |= one
        slot = (key >> np.uint64(8)) & last_slot
        while taken[slot] != free and taken[slot] != key:
            slot = (slot + one) & last_slot
        if taken[slot] == free:
            taken[slot] = key
            rows[count] = row
            count += 1
    return rows[:count].copy()
