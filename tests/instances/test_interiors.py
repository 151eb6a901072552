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


def filled(street, shares=None):
    means, groups = street
    shares = np.zeros((len(means), 2)) if shares is None else shares
    everything = np.ones(len(means), bool)
    return fill_compact_objects(groups, means, np.full(len(means), 0.9), everything, csr_array(shares))


def test_what_floats_inside_a_body_is_its_own(street):
    assert filled(street)[-5:].tolist() == [CAR, CAR, ROAD, ROAD, ROAD]


def test_an_edge_that_partly_shows_the_body_comes_back(street):
    shares = np.zeros((705, 2))
    shares[-2:, CAR] = 0.4
    assert filled(street, shares)[-2:].tolist() == [ROAD, CAR]  # 1.3 m away, and at the hull


def test_surfaces_have_no_inside(street):
    means, groups = street
    flat = groups == ROAD
    only_road = np.where(flat, ROAD, -1)
    result = fill_compact_objects(only_road, means, np.full(len(means), 0.9), flat, csr_array((len(means), 2)))
    np.testing.assert_array_equal(result, only_road)


def test_where_nothing_is_solid_nothing_is_filled(street):
    means, groups = street
    faint, everything = np.full(len(means), 0.001), np.ones(len(means), bool)
    shares = csr_array(np.zeros((len(means), 2)))
    np.testing.assert_array_equal(fill_compact_objects(groups, means, faint, everything, shares), groups)


def test_unseen_gaussians_take_the_nearest_of_their_node():
    means = np.array([[0, 0, 0], [1, 0, 0], [5, 0, 0], [5.1, 0, 0]], np.float32)
    nodes = np.array([0, 0, 0, 1], np.uint16)
    assert fill_from_nearest(np.array([3, -1, 4, -1]), means, nodes).tolist() == [3, 3, 4, -1]


def test_numbers_fall_with_size():
    assert number_by_size(np.array([7, 7, 2, 7, 2, 9, -1])).tolist() == [1, 1, 2, 1, 2, 3, 0]
