"""The order in which splats are merged: by instance, and inside each along a space-filling curve."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, Int32, Int64, UInt16, UInt32, UInt64
from numpy import ndarray

_KEY_BITS = 63
_MOST_AXIS_BITS = 16
_OUTLIERS = 0.001
"""Share of the splats at each end of an axis that do not widen the curve's cube."""
_SAMPLE = 100_000
_MOST_LISTED = 1 << 24


def order_splats(
    means: Float32[ndarray, "n 3"], instance_ids: UInt32[ndarray, " n"], nodes: UInt16[ndarray, " n"]
) -> Int32[ndarray, " n"]:
    """Order splats by what they belong to, then by Morton's curve (Morton 1966).

    What moves apart stays apart: first by `nodes`, then by instance, those side by side near each other.
    """
    if not len(means):
        return np.zeros(0, np.int32)
    group = _number_groups(instance_ids, nodes)
    count = int(group.max()) + 1
    totals = np.stack([np.bincount(group, means[:, axis], count) for axis in range(3)], axis=1)
    centers = (totals / np.bincount(group, minlength=count)[:, None]).astype(np.float32)
    node_of = np.zeros(count, np.uint16)
    node_of[group] = nodes
    low, high = _find_cube(means)
    rank = np.empty(count, np.uint64)
    rank[np.lexsort((_compute_codes(centers, low, high, _MOST_AXIS_BITS), node_of))] = np.arange(count, dtype=np.uint64)
    bits = min(_MOST_AXIS_BITS, (_KEY_BITS - count.bit_length()) // 3)
    keys = rank[group] << np.uint64(3 * bits) | _compute_codes(means, low, high, bits)
    return np.argsort(keys).astype(np.int32)


def _number_groups(instance_ids: UInt32[ndarray, " n"], nodes: UInt16[ndarray, " n"]) -> Int64[ndarray, " n"]:
    """Number the pairs of node and instance that occur; without sorting where IDs are small."""
    pairs = nodes.astype(np.int64) * (int(instance_ids.max()) + 1) + instance_ids
    last = int(pairs.max())
    if last > _MOST_LISTED:
        return np.unique(pairs, return_inverse=True)[1].reshape(-1)
    occurs = np.zeros(last + 1, np.int64)
    occurs[pairs] = 1
    return (np.cumsum(occurs) - 1)[pairs]


def _find_cube(means: Float32[ndarray, "n 3"]) -> tuple[Float32[ndarray, "3"], float]:
    """Lower corner (metres) and side of a cube around all but a few."""
    sample = np.nan_to_num(means[:: max(1, len(means) // _SAMPLE)])
    low, high = np.quantile(sample, [_OUTLIERS, 1 - _OUTLIERS], axis=0).astype(np.float32)
    return low, max(float((high - low).max()), 1e-6)


def _compute_codes(
    places: Float32[ndarray, "n 3"], low: Float32[ndarray, "3"], side: float, bits: int
) -> UInt64[ndarray, " n"]:
    """Interleave the bits of the three coordinates, `bits` of each."""
    last = (1 << bits) - 1
    codes = np.zeros(len(places), np.uint64)
    for axis in range(3):
        cell = np.clip((places[:, axis] - low[axis]) * np.float32(last / side), 0, last)
        cell = np.nan_to_num(cell).astype(np.uint64)
        for shift, mask in _SPREAD:
            cell = (cell | cell << np.uint64(shift)) & np.uint64(mask)
        codes |= cell << np.uint64(axis)
    return codes


_SPREAD = (
    (32, 0x1F00000000FFFF),
    (16, 0x1F0000FF0000FF),
    (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)
"""Shifts and masks that put two zeros between the bits of a number of 21 bits."""
