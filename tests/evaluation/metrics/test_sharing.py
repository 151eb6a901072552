"""Fragmentation and collisions on counts written by hand."""

import numpy as np
import pytest

from instdrive_core.evaluation.metrics.segmentation import count_confusion
from instdrive_core.evaluation.metrics.sharing import (
    Holding,
    compute_mean_count,
    count_covering_ids,
    find_holdings,
    find_shared_ids,
    group_objects_by_id,
)


def counts(*runs: tuple[int, int, int]):
    """From (truth, predicted, how many)."""
    truth = np.concatenate([np.full(count, label) for label, _, count in runs])
    predicted = np.concatenate([np.full(count, label) for _, label, count in runs])
    return count_confusion(truth, predicted)


def test_a_fringe_is_no_fragment():
    held = find_holdings(counts((1, 5, 86), (1, 6, 14), (2, 6, 50)))
    assert held == {1: (Holding(5, 0.86),), 2: (Holding(6, 1.0),)}
    assert find_shared_ids(held) == {}


def test_an_object_in_pieces():
    held = find_holdings(counts((1, 5, 30), (1, 6, 60), (1, 0, 10)))
    assert held == {1: (Holding(6, 0.6), Holding(5, 0.3))}, "what carries no ID belongs to the whole"


def test_equal_shares_are_in_order_of_ids():
    held = find_holdings(counts((1, 9, 50), (1, 3, 50)))
    assert [holding.predicted_id for holding in held[1]] == [3, 9]


def test_objects_that_share_an_id():
    held = find_holdings(counts((1, 5, 10), (2, 5, 70), (2, 6, 30), (3, 7, 4), (4, 0, 9)))
    assert group_objects_by_id(held) == {5: (1, 2), 6: (2,), 7: (3,)}
    assert find_shared_ids(held) == {5: (1, 2)}
    assert held[4] == ()
    assert compute_mean_count(list(held.values())) == pytest.approx(4 / 3), "an object without any ID is not in pieces"
    assert compute_mean_count([(), ()]) is None


def test_a_shattered_object_is_in_all_its_pieces():
    shattered = [(1, piece, 10) for piece in range(1, 11)]
    held = find_holdings(counts(*shattered, (2, 1, 40)))
    assert [holding.predicted_id for holding in held[1]] == list(range(1, 11))
    assert held[2] == (Holding(1, 1.0),)


def test_what_has_hardly_any_id_is_not_shattered():
    assert find_holdings(counts((1, 0, 90), (1, 5, 6), (1, 6, 4))) == {1: ()}


def test_fewest_ids_that_cover_an_object():
    crumbs = [(2, piece, 8) for piece in range(20, 25)]
    found = counts((1, 5, 85), (1, 6, 15), (2, 7, 60), *crumbs, (3, 8, 1), (3, 0, 99), (4, 0, 10))
    assert count_covering_ids(found) == [1, 5, 1], "60 + 8 + 8 + 8 + 8 of 100; what has no ID is left out"
    assert len(find_holdings(found)[2]) == 1
