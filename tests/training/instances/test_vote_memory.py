"""Votes on part of the rows, in blocks, without copies: the same bits, and little memory for five million Gaussians."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import csr_array

from instdrive_core.instances import similarity
from instdrive_core.maths import splat_axes
from instdrive_core.training.instances import mask_agreement, superpoints
from instdrive_core.training.instances.affinity_graph import merge_groups
from instdrive_core.training.instances.mask_agreement import compute_agreements
from instdrive_core.training.instances.mask_votes import compute_vote_shares, sum_mask_areas, vote_groups
from instdrive_core.training.instances.mask_weights import MaskWeights
from instdrive_core.training.instances.superpoints import find_distinct_pairs, find_neighbor_pairs, join_superpoints
from instdrive_core.training.settings.config import GraphConfig

CONFIG = GraphConfig()
GIGABYTE = 1e9


def strewn_weights(count: int, views: int, per_view: int, seed: int = 0) -> tuple[np.ndarray, MaskWeights]:
    """Gaussians on a plane of which each photo shows some, cut into masks like a chess board that shifts."""
    rng = np.random.default_rng(seed)
    means = np.concatenate([rng.uniform(0, 40, (count, 2)), rng.uniform(0, 1, (count, 1))], axis=1)
    rows, masks, view_of_mask = [], [], []
    for view in range(views):
        shown = np.sort(rng.choice(count, min(per_view, count), replace=False))
        cells = np.floor((means[shown, :2] + 0.3 * rng.random(2)) / 4).astype(np.int64) @ [100, 1]
        names, cell = np.unique(cells, return_inverse=True)
        rows.append(shown)
        masks.append(cell + len(view_of_mask))
        view_of_mask += [view] * len(names)
    where = np.concatenate(rows).astype(np.int32), np.concatenate(masks).astype(np.int32)
    values = rng.random(len(where[0]), np.float32) + np.float32(0.01)
    weights = csr_array((values, where), shape=(count, len(view_of_mask)))
    weights.sort_indices()
    unmasked = rng.random(count, np.float32)
    shown = np.asarray(weights.sum(axis=1), np.float32) + unmasked
    return means.astype(np.float32), MaskWeights(weights, np.array(view_of_mask, np.int32), 1, unmasked, shown)


def learn_groups(means: np.ndarray, observed: MaskWeights, rows: np.ndarray) -> np.ndarray:
    """Patches, merging and votes of some rows, as `vote_instances` does it."""
    groups = np.full(len(means), -1, np.int64)
    pairs = find_neighbor_pairs(means[rows], CONFIG.neighbors)
    groups[rows] = merge_groups(observed, join_superpoints(observed, pairs, CONFIG, rows), pairs, CONFIG, rows)
    return vote_groups(observed, groups, np.zeros(len(means), bool), CONFIG)


@pytest.fixture
def small_blocks(monkeypatch):
    for module, name in ((mask_agreement, "_BLOCK"), (superpoints, "_BLOCK"), (similarity, "_BLOCK")):
        monkeypatch.setattr(module, name, 37)
    monkeypatch.setattr(splat_axes, "_BLOCK", 41)


@pytest.mark.usefixtures("small_blocks")
def test_a_part_votes_as_a_copy_of_it_would() -> None:
    """Every number, without the copy: agreements, patches, groups and votes."""
    means, observed = strewn_weights(500, 12, 200)
    rows = np.flatnonzero(np.random.default_rng(1).random(500) < 0.8)
    copy = observed.select_rows(rows)
    pairs = find_neighbor_pairs(means[rows], CONFIG.neighbors)
    np.testing.assert_array_equal(compute_agreements(observed, pairs, rows), compute_agreements(copy, pairs))
    among = np.isin(np.arange(500), rows)
    np.testing.assert_array_equal(
        sum_mask_areas(observed, among), np.asarray(copy.weights.sum(axis=0), np.float32).ravel()
    )
    patches = join_superpoints(copy, pairs, CONFIG)
    np.testing.assert_array_equal(join_superpoints(observed, pairs, CONFIG, rows), patches)
    groups = merge_groups(copy, patches, pairs, CONFIG)
    nobody = np.zeros(500, bool)
    for config in (CONFIG, replace(CONFIG, min_fit=0.6)):
        fixed = nobody.copy()
        fixed[rows[:5]] = True
        expected = vote_groups(copy, groups, fixed[rows], config)
        of_all = np.full(500, -1, np.int64)
        of_all[rows] = groups
        found = vote_groups(observed, of_all, fixed, config)
        np.testing.assert_array_equal(found[rows], expected)
        assert (found[~among] == -1).all()
    assert learn_groups(means, observed, rows).max() > 20


def test_blocks_change_no_bit(monkeypatch) -> None:
    rng = np.random.default_rng(2)
    means, colors, normals = (rng.random((300, 3)).astype(np.float32) for _ in range(3))
    quats, log_scales = rng.normal(size=(300, 4)).astype(np.float32), rng.normal(size=(300, 3)).astype(np.float32)
    groups, nodes = rng.integers(-1, 9, 300), rng.integers(0, 2, 300).astype(np.uint16)
    wide = rng.integers(0, 40, (900, 2))

    def compute() -> list[np.ndarray]:
        similar = similarity.fill_from_similar(groups, rng_mask, means, colors, normals, nodes, 8)
        axes = splat_axes.compute_normals(quats, log_scales)
        return [find_neighbor_pairs(means, 6), find_distinct_pairs(wide), similar, axes]

    rng_mask = rng.random(300) < 0.4
    whole = compute()
    for module in (superpoints, similarity, splat_axes):
        monkeypatch.setattr(module, "_BLOCK", 17)
    for one, other in zip(whole, compute(), strict=True):
        np.testing.assert_array_equal(one, other)
    by_hand = {(min(a, b), max(a, b)) for a, b in wide.tolist() if a != b}
    assert list(map(tuple, whole[1].tolist())) == sorted(by_hand)


def measure_peak(count: int, views: int, per_view: int) -> tuple[float, int]:
    """Bytes at the peak of learning, and the number of weights; the weights themselves are counted, too."""
    means, observed = strewn_weights(count, views, per_view)
    own = observed.weights.data.nbytes + observed.weights.indices.nbytes + observed.weights.indptr.nbytes
    learn_groups(means[:50], strewn_weights(50, 2, 20)[1], np.arange(50))  # compiles
    tracemalloc.start()
    try:
        groups = learn_groups(means, observed, np.arange(count))
        compute_vote_shares(observed, groups)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    return own + peak, observed.weights.nnz


def test_five_million_gaussians_in_480_photos_stay_below_eight_gigabytes(monkeypatch) -> None:
    """By two sizes: what a Gaussian takes, and what a weight takes. A photo's grid of 32,768 pixels holds some twenty
    weights a pixel, when no two pixels share a Gaussian. The Gaussians themselves are held beside that."""
    monkeypatch.setattr(superpoints, "_BLOCK", 1 << 10)  # as small beside these sizes as blocks are beside millions
    monkeypatch.setattr(mask_agreement, "_BLOCK", 1 << 12)
    of_gaussians, few = measure_peak(60_000, 4, 3_000)
    of_weights, many = measure_peak(10_000, 100, 9_000)
    per_gaussian = (of_gaussians - 12 * few) / 60_000
    per_weight = (of_weights - per_gaussian * 10_000) / many
    held = 4 * 59 * 5e6
    total = per_gaussian * 5e6 + per_weight * 480 * 32_768 * 20 + held
    print(f"\n{per_gaussian:.0f} bytes a Gaussian, {per_weight:.1f} a weight: {total / GIGABYTE:.1f} GB")
    assert total < 8 * GIGABYTE
