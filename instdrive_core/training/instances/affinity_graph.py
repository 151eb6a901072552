"""The affinity graph: patches of Gaussians that agree about masks are merged into objects, without any training.

Each round merges the pairs of touching groups that agree best with each other; agreements are then computed anew from
the merged weights (average linkage, weighted by what the photos show). Falling thresholds let sure merges go first.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Int64
from numpy import ndarray

from instdrive_core.training.instances.mask_agreement import compute_agreements, sum_by_group
from instdrive_core.training.instances.mask_weights import MaskWeights
from instdrive_core.training.instances.superpoints import find_distinct_pairs
from instdrive_core.training.settings.config import GraphConfig


def merge_groups(
    observed: MaskWeights,
    patches: Int64[ndarray, " v"],
    pairs: Int64[ndarray, "e 2"],
    config: GraphConfig,
    rows: Int64[ndarray, " v"] | None = None,
) -> Int64[ndarray, " v"]:
    """Merge patches into groups; returns the group 0 … k - 1 of each row.

    Args:
        observed: weights of all rows.
        patches: of each row, 0 … p - 1.
        pairs: neighbouring rows; groups that no pair joins are never merged.
        config: thresholds.
        rows: those that are merged; patches and pairs follow it. None = all.
    """
    count = int(patches.max(initial=-1)) + 1
    of_all = patches
    if rows is not None:
        of_all = np.full(len(observed), -1, np.int64)
        of_all[rows] = patches
    of_patches = sum_by_group(observed, of_all, count)
    touching = find_distinct_pairs(pairs, patches)
    groups = np.arange(count)
    for threshold in config.merge_agreements:
        while (merged := _merge_best_pairs(of_patches, groups, touching, threshold)) is not None:
            groups = merged
    return groups[patches]


def _merge_best_pairs(
    of_patches: MaskWeights, groups: Int64[ndarray, " p"], touching: Int64[ndarray, "e 2"], threshold: float
) -> Int64[ndarray, " p"] | None:
    """Merge the pairs that are each other's best, from `threshold` on; None where there are none."""
    count = int(groups.max(initial=-1)) + 1
    pairs = find_distinct_pairs(touching, groups)
    agreements = compute_agreements(sum_by_group(of_patches, groups, count), pairs)
    order = np.argsort(-agreements, kind="stable")
    order = order[agreements[order] >= threshold]
    best = np.full(count, len(order))  # the place of each group's best pair; of equal ones, the first
    for side in range(2):
        np.minimum.at(best, pairs[order, side], np.arange(len(order)))
    mutual = best[pairs[order, 0]] == best[pairs[order, 1]]
    chosen = pairs[order[mutual]]
    if not len(chosen):
        return None
    names = np.arange(count)
    names[chosen[:, 1]] = chosen[:, 0]
    return np.unique(names, return_inverse=True)[1].astype(np.int64)[groups]
