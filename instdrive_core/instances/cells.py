"""Gaussians gathered into small cells by node, codeword and place, in time proportional to their number."""

from __future__ import annotations

from dataclasses import dataclass
from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Float, Float64, Int64, UInt16, UInt32
from numpy import ndarray

_HASH = np.uint64(0x9E3779B97F4A7C15)
"""2⁶⁴ over the golden ratio: Knuth's multiplicative hashing."""


@dataclass(frozen=True)
class Cells:
    """Small cells of Gaussians that lie close together, belong to one node and carry one codeword."""

    cell_of_gaussian: Int64[ndarray, " n"]
    positions: Float64[ndarray, "m 3"]
    """Mean of the Gaussians' means, metres."""
    groups: Int64[ndarray, " m"]
    """Number of the (node, codeword) pair, in the order of nodes, then codewords."""
    nodes: Int64[ndarray, " m"]
    extents: Float64[ndarray, " m"]
    """Mean of the Gaussians' middle standard deviations, metres."""
    support: Float64[ndarray, " m"]
    """Sum of the Gaussians' opacities."""
    counts: Int64[ndarray, " m"]
    """Number of the Gaussians."""


def gather_cells(
    means: Float[ndarray, "n 3"],
    scales: Float[ndarray, "n 3"],
    nodes: UInt16[ndarray, " n"],
    codewords: UInt32[ndarray, " n"],
    opacities: Float[ndarray, " n"],
    size: float,
) -> Cells:
    """Gather Gaussians into cells of about `size` metres. All means and scales must be finite."""
    group_of, pairs = _number_keys((nodes.astype(np.int64) << 32) | codewords)
    order = np.argsort(pairs)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    groups, center = rank[group_of], np.median(means, axis=0).astype(np.float64)
    cell_of, _ = _number_keys(_compute_cell_keys(means, groups, center, size, 0.0))
    # A second grid, half a cell aside, joins what a border of the first cuts: clones in one place, above all.
    firsts = _sum_values(means, cell_of)
    firsts /= np.bincount(cell_of)[:, None]
    second_of, _ = _number_keys(
        _compute_cell_keys(firsts, _find_shared(groups, cell_of, len(firsts)), center, size, 0.5)
    )
    cell_of = second_of[cell_of]
    counts = np.bincount(cell_of)
    group_of_cell: Int64[ndarray, " m"] = _find_shared(groups, cell_of, len(counts))
    return Cells(
        cell_of_gaussian=cell_of,
        positions=_sum_values(means, cell_of) / counts[:, None],
        groups=group_of_cell,
        nodes=np.sort(pairs)[group_of_cell] >> 32,
        extents=_sum_values(_find_middles(scales)[:, None], cell_of)[:, 0] / counts,
        support=_sum_values(opacities[:, None], cell_of)[:, 0],
        counts=counts,
    )


@numba.njit(cache=True, error_model="numpy")
@no_type_check
def _number_keys(keys):
    """Number the keys of rows 0 … m - 1, in the order of their first rows; returns the numbers and the m keys."""
    bits = 4
    while (1 << bits) < 2 * len(keys):
        bits += 1
    slots, mask, shift = np.full(1 << bits, -1, np.int32), (1 << bits) - 1, np.uint64(64 - bits)
    numbers, different, count = np.empty(len(keys), np.int64), np.empty(len(keys), np.int64), 0
    for row in range(len(keys)):
        key = keys[row]
        slot = np.int64((np.uint64(key) * _HASH) >> shift)
        while slots[slot] >= 0 and different[slots[slot]] != key:
            slot = (slot + 1) & mask
        if slots[slot] < 0:
            slots[slot], different[count] = count, key
            count += 1
        numbers[row] = slots[slot]
    return numbers, different[:count].copy()


@numba.njit(cache=True, error_model="numpy")
@no_type_check
def _compute_cell_keys(places, groups, center, size, offset):
    """Combine group and cell of each place into one number.

    14 bits an axis: strays beyond 8,192 cells from the centre share the outermost ones.
    """
    keys = np.empty(len(places), np.int64)
    for row in range(len(places)):
        key = groups[row]
        for axis in range(3):
            step = np.floor((places[row, axis] - center[axis]) / size + offset)
            key = (key << 14) | (np.int64(min(max(step, -8192.0), 8191.0)) + 8192)
        keys[row] = key
    return keys


@numba.njit(cache=True, error_model="numpy")
@no_type_check
def _sum_values(values, number_of):
    sums = np.zeros((number_of.max() + 1, values.shape[1]))
    for row in range(len(values)):
        for column in range(values.shape[1]):
            sums[number_of[row], column] += values[row, column]
    return sums


@numba.njit(cache=True)
@no_type_check
def _find_shared(values, number_of, count):
    """Find the value that all rows of one number share."""
    shared = np.empty(count, values.dtype)
    for row in range(len(values)):
        shared[number_of[row]] = values[row]
    return shared


@numba.njit(cache=True, error_model="numpy")
@no_type_check
def _find_middles(scales):
    middles = np.empty(len(scales), scales.dtype)
    for row in range(len(scales)):
        a, b, c = scales[row, 0], scales[row, 1], scales[row, 2]
        middles[row] = max(min(a, b), min(max(a, b), c))
    return middles
