"""IDs of what photos never show."""

import numpy as np
import pytest
from scipy.sparse import csr_array

from instdrive_core.instances.id_assignment import number_by_size
from instdrive_core.instances.interiors import fill_compact_objects, fill_from_nearest

ROAD, CAR = 0, 1


@pytest.fixture
def street():
    """A road, a car's shell on it, and Gaussians of the road that float inside, below and beside the car."""
    rng = np.random.default_rng(0)
    road = np.column_stack([rng.uniform(-20, 20, (400, 2)), np.zeros(400)])
    shell = rng.normal(size=(300, 3))
    shell = shell / np.abs(shell).max(axis=1, keepdims=True) * [2.2, 0.9, 0.7] + [0, 0, 0.9]
    loose = np.array([[0.5, 0, 0.9], [0, 0.3, 1.2], [0, 0, 0.05], [3.5, 0, 0.9], [2.25, 0, 0.9]])
    means = np.concatenate([road, shell, loose]).astype(np.float32)
    groups = np.concatenate([np.full(400, ROAD), np.full(300, CAR), np.full(5, ROAD)])
    return means, groups


def filled(street, shares=None, shown=None, opacity=0.9):
    means, groups = street
    count = len(means)
    shares = np.zeros((count, groups.max() + 1)) if shares is None else shares
    shown = np.full(count, 10.0) if shown is None else shown
    everything = np.ones(count, bool)
    return fill_compact_objects(groups, means, np.full(count, opacity), everything, csr_array(shares), shown)


def test_what_floats_inside_a_body_is_its_own(street):
    assert filled(street)[-5:].tolist() == [CAR, CAR, ROAD, ROAD, ROAD]


def test_an_edge_that_partly_shows_the_body_comes_back(street):
    shares = np.zeros((705, 2))
    shares[-2:, CAR] = 0.4
    assert filled(street, shares)[-2:].tolist() == [ROAD, CAR]  # 1.3 m away, and at the hull


def test_a_side_that_photos_hardly_show_needs_fewer_votes(street):
    shares, shown = np.zeros((705, 2)), np.full(705, 10.0)
    shares[-2:, CAR] = 0.2
    assert filled(street, shares, shown)[-1] == ROAD
    shares[-3:, CAR], shown[-3:] = 0.2, 0.5
    assert filled(street, shares, shown)[-3:].tolist() == [ROAD, ROAD, CAR]  # below, 1.3 m away, and at the hull


def test_a_few_splats_far_behind_do_not_hide_that_something_is_compact(street):
    means, groups = street
    means[np.flatnonzero(groups == CAR)[:12]] = [0, 40, 1]
    assert filled((means, groups))[-5:].tolist() == [CAR, CAR, ROAD, ROAD, ROAD]
    means[np.flatnonzero(groups == CAR)[:60]] = [0, 40, 1]  # every fifth is no stray
    assert filled((means, groups))[-5:].tolist() == [ROAD] * 5


@pytest.mark.parametrize(("share", "owner"), [(0.0, "small"), (0.3, "small"), (0.9, "large")])
def test_votes_and_sizes_decide_between_two_hulls(share, owner):
    rng = np.random.default_rng(0)
    large = rng.uniform(-1, 1, (200, 3)) * [2, 1, 1] + [0, 0, 1]
    small = rng.uniform(-1, 1, (200, 3)) * [1, 0.5, 0.8] + [0, 0, 1]
    means = np.concatenate([large, small, [[0, 0, 1]]]).astype(np.float32)
    groups = np.repeat([0, 1, 2], [200, 200, 1])
    shares = np.zeros((401, 3))
    shares[-1, :2] = share, 0.1  # the large one is five times as large
    assert filled((means, groups), shares)[-1] == ["large", "small"].index(owner)


def test_surfaces_have_no_inside(street):
    means, groups = street
    only_road = np.where(groups == ROAD, ROAD, -1)
    np.testing.assert_array_equal(filled((means, only_road)), only_road)


def test_where_nothing_is_solid_nothing_is_filled(street):
    np.testing.assert_array_equal(filled(street, opacity=0.001), street[1])


def test_unseen_gaussians_take_the_nearest_of_their_node():
    means = np.array([[0, 0, 0], [1, 0, 0], [5, 0, 0], [5.1, 0, 0]], np.float32)
    nodes = np.array([0, 0, 0, 1], np.uint16)
    assert fill_from_nearest(np.array([3, -1, 4, -1]), means, nodes).tolist() == [3, 3, 4, -1]


def test_numbers_fall_with_size():
    assert number_by_size(np.array([7, 7, 2, 7, 2, 9, -1])).tolist() == [1, 1, 2, 1, 2, 3, 0]
