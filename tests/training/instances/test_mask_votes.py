"""Names of masks and votes of Gaussians, on hand-made photos."""

from dataclasses import replace

import numpy as np
import pytest
from observed_masks import observed

from instdrive_core.training.instances.mask_votes import (
    compute_vote_shares,
    find_mask_owners,
    measure_group_fits,
    vote_groups,
)
from instdrive_core.training.settings.config import GraphConfig

CONFIG = GraphConfig()
NOBODY = np.zeros(12, bool)
OBJECTS = np.repeat([0, 1], 6)


def test_a_thin_thing_owns_its_mask_although_the_wall_behind_weighs_more_in_it():
    pole, wall = [0, 1], list(range(2, 12))
    masks = [{0: 1.0, 1: 1.0, 2: 1.5, 3: 1.5}, dict.fromkeys(wall, 3.0)]
    owners = find_mask_owners(observed(12, masks), np.array([0, 0] + [1] * 10))
    np.testing.assert_array_equal(owners, [0, 1])
    assert len(pole) == 2


def test_a_mask_without_anything_has_no_owner():
    assert find_mask_owners(observed(3, [[0], [1]]), np.array([0, -1, -1])).tolist() == [0, -1]


def test_a_wrong_gaussian_follows_its_masks():
    wrong = OBJECTS.copy()
    wrong[2] = 1
    groups = vote_groups(observed(12, *[[range(6), range(6, 12)]] * 3), wrong, NOBODY, CONFIG)
    np.testing.assert_array_equal(groups, OBJECTS)


def test_a_gaussian_leaves_its_group_for_a_clear_majority_only():
    """Two of three photos take row 5 for the second object; without a majority to reach, that is enough."""
    apart, joined = [range(6), range(6, 12)], [range(5), range(5, 12)]
    photos = observed(12, apart, joined, joined)
    for majority, group in ((0.0, 1), (0.6, 1), (0.7, 0)):
        assert vote_groups(photos, OBJECTS, NOBODY, CONFIG, majority)[5] == group
    lost = OBJECTS.copy()
    lost[5] = 2  # a fragment has no group to stay in
    assert vote_groups(photos, lost, NOBODY, CONFIG, 0.7)[5] == 1


def test_masks_that_leave_nothing_out_are_believed_as_they_are():
    config = GraphConfig()
    assert config.get_majority(0.0) == 0
    assert config.get_majority(0.25) == config.majority / 2
    assert config.get_majority(0.5) == config.get_majority(1.0) == config.majority


def test_fragments_give_themselves_away():
    fragments = np.array([0, 0, 0, 0, 2, 2, 1, 1, 1, 1, 1, 3])
    photos = observed(12, *[[range(6), range(6, 12)]] * 3)
    np.testing.assert_array_equal(vote_groups(photos, fragments, NOBODY, CONFIG), OBJECTS)


def test_groups_that_fit_no_mask_are_dissolved():
    fits = measure_group_fits(observed(12, [range(6), range(6, 12)]), np.array([0] * 5 + [2] + [1] * 6))
    np.testing.assert_allclose(fits, [5 / 6, 1, 1 / 6], rtol=1e-6)


def test_fixed_rows_keep_their_group():
    fixed = NOBODY.copy()
    fixed[2] = True
    wrong = OBJECTS.copy()
    wrong[2] = 1
    groups = vote_groups(observed(12, *[[range(6), range(6, 12)]] * 3), wrong, fixed, CONFIG)
    assert groups[2] == groups[7]
    assert groups[3] != groups[2]


def test_shares_sum_to_one_where_anything_was_seen():
    shares = compute_vote_shares(observed(3, [[0, 1]], [{0: 3.0}, {1: 1.0}]), np.array([0, 1, 1])).toarray()
    assert shares.sum(axis=1) == pytest.approx([1, 1, 0])


def test_voting_ends_where_rounds_end():
    groups = vote_groups(observed(12, [range(12)]), OBJECTS, NOBODY, replace(CONFIG, vote_rounds=0, min_fit=0))
    np.testing.assert_array_equal(groups, OBJECTS)
