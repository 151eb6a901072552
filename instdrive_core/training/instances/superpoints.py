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

_BLOCK = 1 << 18
"""Points, or pairs, that are looked at in one go: what is not yet one number a pair takes several times as much."""


def find_neighbor_pairs(means: Float[ndarray, "n 3"], neighbors: int) -> Int64[ndarray, "e 2"]:
    """Pair each point with its nearest ones; every pair once, the lower row first, sorted."""
    count = min(neighbors + 1, len(means))
    tree = KDTree(means)
    keys = np.full((len(means), count), -1, np.int64)
    for start in range(0, len(means), _BLOCK):
        block = slice(start, min(start + _BLOCK, len(means)))
        _, found = tree.query(means[block], k=count, workers=numba.get_num_threads())
        sources = np.arange(block.start, block.stop)[:, None]
        keys[block] = _make_keys(sources, np.reshape(found, (len(sources), count)))
    return _read_keys(keys.reshape(-1))


def find_distinct_pairs(pairs: Int[ndarray, "e 2"], names: Int64[ndarray, " n"] | None = None) -> Int64[ndarray, "k 2"]:
    """Find every unordered pair of different numbers once, sorted.

    With `names`, the pairs are those of the names of the given numbers.
    """
    keys = np.empty(len(pairs), np.int64)
    for start in range(0, len(pairs), _BLOCK):
        block = pairs[start : start + _BLOCK]
        block = block if names is None else names[block]
        keys[start : start + _BLOCK] = _make_keys(block[:, 0], block[:, 1])
    return _read_keys(keys)


def _make_keys(first: Int[ndarray, "..."], second: Int[ndarray, "..."]) -> Int64[ndarray, "..."]:
    """One number for each unordered pair; -1 for a number paired with itself."""
    low, high = np.minimum(first, second).astype(np.int64), np.maximum(first, second).astype(np.int64)
    return np.where(low == high, -1, low << 32 | high)


def _read_keys(keys: Int64[ndarray, " e"]) -> Int64[ndarray, "k 2"]:
    """The pairs behind the keys, each once, sorted. Sorts the keys where they are."""
    keys.sort()
    new = np.empty(len(keys), bool)
    new[:1] = True
    np.not_equal(keys[1:], keys[:-1], out=new[1:])
    new &= keys >= 0
    keys = keys[new]
    pairs = np.empty((len(keys), 2), np.int64)
    np.right_shift(keys, 32, out=pairs[:, 0])
    np.bitwise_and(keys, 0xFFFFFFFF, out=pairs[:, 1])
    return pairs


def join_superpoints(
    observed: MaskWeights,
    pairs: Int64[ndarray, "e 2"],
    config: GraphConfig,
    rows: Int64[ndarray, " v"] | None = None,
) -> Int64[ndarray, " v"]:
    """Join pairs into patches from the best agreement down (Kruskal); returns the patch 0 … k - 1 of each row.

    With `rows` only these are joined, and pairs hold places in it.

    A pair is joined if its agreement is at least `config.patch_agreement` and the patch has at most `config.patch_size`
    rows.

    Small patches keep a Gaussian that straddles a border from chaining two objects together.
    """
    agreements = compute_agreements(observed, pairs, rows)
    agreed = np.flatnonzero(agreements >= config.patch_agreement)
    order = agreed[np.argsort(-agreements[agreed], kind="stable")]
    roots = _join_pairs(pairs, order, len(observed) if rows is None else len(rows), config.patch_size)
    return np.unique(roots, return_inverse=True)[1].astype(np.int64)


@numba.njit(cache=True, error_model="numpy")
def _find_root(parents, row):
    while parents[row] != row:
        parents[row] = parents[parents[row]]
        row = parents[row]
    return row


@numba.njit(cache=True, error_model="numpy")
def _join_pairs(pairs, order, count, limit):
    """Join the pairs in an order, up to `limit` rows together; returns the root of each row."""
    parents, sizes = np.arange(count), np.ones(count, np.int64)
    for pair in order:
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
