"""Superpoints: small patches of neighbouring Gaussians that nearly all photos put into the same masks."""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float, Int, Int64
from numpy import ndarray
from scipy.spatial import KDTree

from instdrive_core.training.instances.mask_agreement import compute_agreements
from instdrive_core.training.instances.mask_weights import MaskWeights
from instdrive_core.training.settings.config import GraphConfig


def find_neighbor_pairs(means: Float[ndarray, "n 3"], neighbors: int) -> Int64[ndarray, "e 2"]:
    """Pair each point with its nearest ones; every pair once, the lower row first, sorted."""
    count = min(neighbors + 1, len(means))
    _, found = KDTree(means).query(means, k=count, workers=numba.get_num_threads())
    found = np.reshape(found, (len(means), count))
    sources = np.repeat(np.arange(len(means)), count)
    return find_distinct_pairs(np.stack([sources, found.ravel()], axis=1))


def find_distinct_pairs(pairs: Int[ndarray, "e 2"]) -> Int64[ndarray, "k 2"]:
    """Find every unordered pair of different numbers once, sorted."""
    low, high = pairs.min(axis=1).astype(np.int64), pairs.max(axis=1).astype(np.int64)
    keys = np.sort((low << 32 | high)[low != high])
    keys = keys[np.flatnonzero(np.diff(keys, prepend=-1))]
    return np.stack([keys >> 32, keys & 0xFFFFFFFF], axis=1)


def join_superpoints(observed: MaskWeights, pairs: Int64[ndarray, "e 2"], config: GraphConfig) -> Int64[ndarray, " n"]:
    """Join pairs into patches from the best agreement down (Kruskal); returns the patch 0 … k - 1 of each row.

    A pair is joined if its agreement is at least `config.patch_agreement` and the patch has at most `config.patch_size`
    rows.

    Small patches keep a Gaussian that straddles a border from chaining two objects together.
    """
    agreements = compute_agreements(observed, pairs)
    order = np.argsort(-agreements, kind="stable")
    order = order[agreements[order] >= config.patch_agreement]
    roots = _join_pairs(pairs[order], len(observed), config.patch_size)
    return np.unique(roots, return_inverse=True)[1].astype(np.int64)


@numba.njit(cache=True, error_model="numpy")
def _find_root(parents, row):
    while parents[row] != row:
        parents[row] = parents[parents[row]]
        row = parents[row]
    return row


@numba.njit(cache=True, error_model="numpy")
def _join_pairs(pairs, count, limit):
    """Join the pairs in their order, up to `limit` rows together; returns the root of each row."""
    parents, sizes = np.arange(count), np.ones(count, np.int64)
    for pair in range(len(pairs)):
        a, b = _find_root(parents, pairs[pair, 0]), _find_root(parents, pairs[pair, 1])
        if a == b or sizes[a] + sizes[b] > limit:
            continue
        if sizes[a] < sizes[b]:
            a, b = b, a
        parents[b] = a
        sizes[a] += sizes[b]
    for row in range(count):
        parents[row] = _find_root(parents, row)
    return parents
