"""Agreement of Gaussians about masks, patches and merging, on hand-made photos."""

from dataclasses import replace

import numpy as np
import pytest
from observed_masks import observed

from instdrive_core.training.instances.affinity_graph import merge_groups
from instdrive_core.training.instances.mask_agreement import compute_agreements, sum_by_group
from instdrive_core.training.instances.superpoints import find_distinct_pairs, find_neighbor_pairs, join_superpoints
from instdrive_core.training.settings.config import GraphConfig

CONFIG = GraphConfig()
LEFT, RIGHT = list(range(10)), list(range(10, 20))
CHAIN = np.stack([np.arange(19), np.arange(1, 20)], axis=1)
"""Twenty Gaussians in a row, each next to the following one."""


def test_agreement_is_the_overlap_of_shares_averaged_over_photos_that_show_both():
    photos = observed(3, [[0, 1], [2]], [[0], [1, 2]], [[0, 2]], [{0: 3.0, 1: 1.0}, {1: 1.0}])
    values = compute_agreements(photos, np.array([[0, 1], [1, 2], [0, 2]]))
    # 0 and 1: together, apart, -, half of 1 is in 0's mask and both weigh at least 2 there.
    assert values[0] == pytest.approx((1 * 1 + 1 * 0 + 2 * 0.5) / 4)
    assert values[1] == pytest.approx((0 + 1) / 2)
    assert values[2] == pytest.approx((0 + 0 + 1) / 3)


def test_what_no_photo_shows_together_has_no_agreement():
    photos = observed(3, [[0]], [[1]])
    np.testing.assert_array_equal(compute_agreements(photos, np.array([[0, 1], [0, 2]])), [-1, -1])


def test_groups_weigh_what_their_rows_weigh():
    summed = sum_by_group(observed(4, [[0, 1], [2, 3]]), np.array([1, 1, 0, -1]), 2)
    np.testing.assert_array_equal(summed.weights.toarray(), [[0, 1], [2, 0]])


def test_pairs_are_distinct_and_never_of_one():
    pairs = find_distinct_pairs(np.array([[3, 1], [1, 3], [2, 2], [0, 5]]))
    np.testing.assert_array_equal(pairs, [[0, 5], [1, 3]])


def test_neighbors_are_the_nearest():
    pairs = find_neighbor_pairs(np.array([[0.0, 0, 0], [1, 0, 0], [2.5, 0, 0], [9, 0, 0]]), 1)
    np.testing.assert_array_equal(pairs, [[0, 1], [1, 2], [2, 3]])


def test_patches_stay_small_and_pure():
    photos = observed(20, *[[LEFT, RIGHT]] * 3)
    patches = join_superpoints(photos, CHAIN, replace(CONFIG, patch_size=4))
    assert np.bincount(patches).max() <= 4
    assert not set(patches[:10]) & set(patches[10:])


def groups_of(*photos):
    photos = observed(20, *photos)
    return merge_groups(photos, np.arange(20), CHAIN, CONFIG)


def test_a_gaussian_on_the_border_does_not_chain_two_objects():
    border = [{**dict.fromkeys(LEFT, 1.0), 10: 0.5}, {**dict.fromkeys(RIGHT[1:], 1.0), 10: 0.5}]
    groups = groups_of(*[border] * 4)
    assert groups[0] == groups[9]
    assert groups[11] == groups[19]
    assert groups[0] != groups[19]


def test_faults_of_single_photos_are_outvoted():
    split, merged = [LEFT[:5], LEFT[5:], RIGHT], [LEFT + RIGHT]
    groups = groups_of([LEFT, RIGHT], split, [LEFT, RIGHT], merged, [LEFT, RIGHT], [RIGHT])
    assert len(set(groups[:10])) == len(set(groups[10:])) == 1
    assert groups[0] != groups[10]


def test_parts_that_no_photo_shows_together_join_through_what_lies_between():
    first, second = list(range(14)), list(range(6, 20))
    assert len(set(groups_of([first], [second]))) == 1
