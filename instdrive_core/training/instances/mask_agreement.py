"""Agreement of groups of Gaussians about masks: in photos that show both, are they in the same ones?"""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float32, Int64, Integer
from numpy import ndarray
from scipy.sparse import csr_array

from instdrive_core.training.instances.mask_weights import MaskWeights


def sum_by_group(observed: MaskWeights, groups: Integer[ndarray, " n"], count: int) -> MaskWeights:
    """Sum the weights of `count` groups of rows; a group of -1 is none."""
    chosen = np.flatnonzero(groups >= 0)
    entries = (np.ones(len(chosen), np.float32), (groups[chosen], chosen))
    summed = csr_array(csr_array(entries, shape=(count, len(groups))) @ observed.weights)
    summed.sort_indices()
    return MaskWeights(summed, observed.view_of_mask, observed.layers)


_BLOCK = 1 << 20
"""Pairs that are looked at in one go."""


def compute_agreements(
    observed: MaskWeights, pairs: Integer[ndarray, "e 2"], rows: Int64[ndarray, " v"] | None = None
) -> Float32[ndarray, " e"]:
    """Compute how much the two rows of each pair are in the same masks: 0 to 1, or -1 where no photo shows both.

    With `rows`, pairs hold places in it, so that a part of the rows can be asked about without a copy of their weights.

    In one photo it is Σ_m min(p_m, q_m), with p and q the shares of either's weight that lie in mask m. Photos are
    averaged, each with the weight of the one that it shows less of. Where a photo has several layers of masks, the one
    counts in which the two agree most: parts of an object agree by the mask of the whole. A mask that is missing says
    nothing; one that a segmenter split or merged by mistake is outvoted by the other photos.
    """
    result = np.empty(len(pairs), np.float32)
    matrix = observed.weights
    arrays = (
        matrix.indptr.astype(np.int64),
        matrix.indices.astype(np.int32, copy=False),
        matrix.data.astype(np.float32, copy=False),
    )
    numbers = observed.view_of_mask.astype(np.int32, copy=False)
    for start in range(0, len(pairs), _BLOCK):
        block = pairs[start : start + _BLOCK]
        asked = np.ascontiguousarray(block if rows is None else rows[block], np.int64)
        _agree(*arrays, numbers, observed.layers, asked, result[start : start + _BLOCK])
    return result


@numba.njit(cache=True, error_model="numpy")
def find_end_of_view(masks, view_of_mask, entry, end):
    """Find the first of a row's entries after `entry` that lies in another view; compiled."""
    view = view_of_mask[masks[entry]]
    while entry < end and view_of_mask[masks[entry]] == view:
        entry += 1
    return entry


@numba.njit(cache=True, error_model="numpy")
def _overlap(masks, values, a, a_end, b, b_end):
    """Σ min of the shares in one view, and the smaller of the two weights."""
    total_a, total_b, shared = values[a:a_end].sum(), values[b:b_end].sum(), 0.0
    while a < a_end and b < b_end:
        if masks[a] < masks[b]:
            a += 1
        elif masks[b] < masks[a]:
            b += 1
        else:
            shared += min(values[a] / total_a, values[b] / total_b)
            a += 1
            b += 1
    return shared, min(total_a, total_b)


@numba.njit(parallel=True, cache=True, error_model="numpy")
def _agree(starts, masks, values, view_of_mask, layers, pairs, result):
    for pair in numba.prange(len(pairs)):
        a, b = starts[pairs[pair, 0]], starts[pairs[pair, 1]]
        a_end, b_end = starts[pairs[pair, 0] + 1], starts[pairs[pair, 1] + 1]
        agreed, weight = 0.0, 0.0
        photo, best_shared, best_weight = -1, 0.0, 0.0
        while a < a_end and b < b_end:
            view_a, view_b = view_of_mask[masks[a]], view_of_mask[masks[b]]
            next_a, next_b = a, b
            if view_a <= view_b:
                next_a = find_end_of_view(masks, view_of_mask, a, a_end)
            if view_b <= view_a:
                next_b = find_end_of_view(masks, view_of_mask, b, b_end)
            if view_a == view_b:
                shared, smaller = _overlap(masks, values, a, next_a, b, next_b)
                if view_a // layers != photo:
                    agreed += best_weight * best_shared
                    weight += best_weight
                    photo, best_shared, best_weight = view_a // layers, -1.0, 0.0
                if shared > best_shared:
                    best_shared, best_weight = shared, smaller
            a, b = next_a, next_b
        agreed += best_weight * best_shared
        weight += best_weight
        result[pair] = agreed / weight if weight > 0 else -1.0
