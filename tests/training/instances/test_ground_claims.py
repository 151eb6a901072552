"""The height above the ground, which groups are ground, and what the ground takes back."""

import numpy as np
import pytest

from instdrive_core.training.instances.ground_claims import claim_flat
from instdrive_core.training.instances.ground_height import find_ground_groups, measure_heights

ROAD, PAVEMENT, CAR = range(3)


def grid(x, y, height, spacing=0.2):
    """A grid of points over two spans."""
    places = np.stack(np.meshgrid(np.arange(*x, spacing), np.arange(*y, spacing)), axis=-1).reshape(-1, 2)
    return np.column_stack([places, np.full(len(places), height)]).astype(np.float32)


def test_heights_are_those_above_the_nearest_ground_and_unknown_far_from_it():
    ground = grid((0, 10), (0, 4), 2.0)
    ground[:, 2] += np.random.default_rng(0).normal(0, 0.01, len(ground))
    heights = measure_heights(np.array([[5, 2, 2], [5, 2, 3.5], [5, 2, 0], [30, 2, 2]], np.float32), ground)
    np.testing.assert_allclose(heights, [0, 1.5, -2, np.inf], atol=0.03)
    assert np.isinf(measure_heights(ground, ground[:0])).all()


def test_points_on_the_foot_of_a_cone_do_not_lift_the_ground():
    ground = np.concatenate([grid((0, 10), (0, 4), 0.0, 0.25), [[5, 2, 0.2], [5.02, 2, 0.3], [5, 2.02, 0.35]]])
    assert measure_heights(np.array([[5, 2, 0.35]], np.float32), ground.astype(np.float32))[0] == pytest.approx(0.35)


def test_a_group_is_ground_if_nearly_all_of_it_lies_there_and_stands_still():
    groups = np.array([0, 0, 0, 0, 1, 1, 2, 2, -1])
    heights = np.array([0, 0.1, -3, 0, 0, 1, 0, 0, 0], np.float32)
    nodes = np.array([0, 0, 0, 0, 0, 0, 1, 1, 0], np.uint16)
    weights = np.ones(9, np.float32)
    assert find_ground_groups(groups, weights, nodes, heights).tolist() == [True, False, False]
    weights[5] = 0.2  # hardly seen
    assert find_ground_groups(groups, weights, nodes, heights).tolist() == [True, True, False]


class Parked:
    """A car at a kerb (y = 4) whose mask holds its shadow, too, on the road and on the pavement."""

    def __init__(self):
        road, pavement = grid((0, 20), (0, 4), 0.0), grid((0, 20), (4, 7), 0.12)
        self.ground = np.concatenate([road, pavement])
        body = np.concatenate([grid((8, 12), (2.2, 3.8), height) for height in (0.4, 0.8, 1.2)])
        self.means = np.concatenate([self.ground, body])
        self.groups = np.repeat([ROAD, PAVEMENT, CAR], [len(road), len(pavement), len(body)])
        x, y, z = self.means.T
        self.shadow = (np.abs(x - 10) < 2.5) & (y > 1.5) & (y < 4.8) & (z < 0.3)
        self.groups[self.shadow] = CAR
        self.nodes = np.zeros(len(self.groups), np.uint16)
        self.thicknesses = np.full(len(self.groups), 0.01, np.float32)
        self.weights = np.ones(len(self.groups), np.float32)

    def claim(self):
        heights = measure_heights(self.means, self.ground)
        return claim_flat(self.groups, self.weights, self.nodes, self.means, self.thicknesses, heights)


def test_road_and_pavement_take_back_the_shadow_each_its_own_part():
    parked = Parked()
    claimed = parked.claim()
    high = parked.means[:, 2] > 0.06
    inside = np.abs(parked.means[:, 1] - 4) > 0.8  # at the kerb itself, the lower of both is the ground
    assert set(claimed[parked.shadow & ~high].tolist()) == {ROAD}
    assert set(claimed[parked.shadow & high & inside].tolist()) <= {PAVEMENT}
    np.testing.assert_array_equal(claimed[~parked.shadow], parked.groups[~parked.shadow])


def test_what_stands_moves_or_was_not_seen_stays():
    parked = Parked()
    x, y, _ = parked.means.T
    rows = np.flatnonzero(parked.shadow & (np.abs(x - 10) < 1) & (np.abs(y - 3) < 0.5))[:3]  # below the car
    parked.thicknesses[rows[0]], parked.nodes[rows[1]], parked.weights[rows[2]] = 0.2, 1, 0
    claimed = parked.claim()
    assert claimed[rows].tolist() == [CAR] * 3
    assert (claimed == CAR).sum() < (parked.groups == CAR).sum()


def test_without_any_ground_nothing_is_claimed():
    parked = Parked()
    parked.ground = parked.ground[:0]
    np.testing.assert_array_equal(parked.claim(), parked.groups)


def test_what_is_low_and_far_from_all_that_stands_of_its_thing_is_ground_however_thick():
    parked = Parked()
    parked.thicknesses[parked.shadow] = 0.15
    claimed = parked.claim()
    far = parked.shadow & ((np.abs(parked.means[:, 0] - 10) > 2.45) | (parked.means[:, 1] < 1.7))
    near = parked.shadow & (np.abs(parked.means[:, 0] - 10) < 2.1) & (parked.means[:, 1] > 2.0)
    assert set(claimed[far & (parked.means[:, 1] < 3.5)].tolist()) == {ROAD}
    assert set(claimed[near & (parked.means[:, 1] < 3.5)].tolist()) == {CAR}


def test_a_thing_of_which_nothing_stands_keeps_what_is_thick():
    parked = Parked()
    parked.thicknesses[parked.shadow] = 0.15
    parked.groups[parked.means[:, 2] > 0.3] = -1
    np.testing.assert_array_equal(parked.claim(), parked.groups)
