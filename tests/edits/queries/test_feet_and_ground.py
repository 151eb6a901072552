"""Where things stand, among the stray splats that training leaves below the ground."""

from __future__ import annotations

import numpy as np
import pytest

from instdrive_core.edits.queries.ground_height import estimate_ground_height
from instdrive_core.edits.queries.placement import drop_strays, estimate_foot


def scatter(count, low, high, seed=0):
    return np.random.default_rng(seed).uniform(low, high, (count, 3)).astype(np.float32)


def test_a_car_stands_on_its_wheels_however_much_hangs_below():
    car, strays = scatter(4000, [-2, -0.9, 0], [2, 0.9, 1.5]), scatter(240, [-3, -3, -15], [3, 3, -0.5])
    points = np.concatenate([car, strays])
    assert estimate_foot(points[:, 2]) < -3
    assert estimate_foot(drop_strays(points)[:, 2]) == pytest.approx(0, abs=0.1)


def test_a_trunk_is_no_stray():
    crown, trunk = scatter(6000, [-2, -2, 3], [2, 2, 6]), scatter(160, [-0.1, -0.1, 0], [0.1, 0.1, 3])
    kept = drop_strays(np.concatenate([crown, trunk]))
    assert kept[:, 2].min() < 0.2


@pytest.mark.parametrize("count", [0, 1, 5, 6])
def test_few_points_are_enough(count):
    assert len(drop_strays(scatter(count, 0, 1))) == count


def test_copies_of_one_point_stay():
    assert len(drop_strays(np.ones((50, 3), np.float32))) == 50


@pytest.mark.parametrize("below", [0, 40, 150])
def test_ground_is_a_layer_and_not_what_is_spread_below_it(below):
    road = scatter(200, [-2, -2, -0.03], [2, 2, 0.03])
    strays, car = scatter(below, [-2, -2, -12], [2, 2, -0.5]), scatter(600, [1, -2, 0.2], [2, 2, 1.5])
    height = estimate_ground_height(np.concatenate([road, strays, car]), np.zeros(3))
    assert height == pytest.approx(0, abs=0.05)


@pytest.mark.parametrize("slope", [0.1, 0.4])
def test_ground_may_slope(slope):
    road = scatter(400, [-2, -2, -0.03], [2, 2, 0.03])
    road[:, 2] += slope * road[:, 0]
    assert estimate_ground_height(road, np.zeros(3)) == pytest.approx(0, abs=0.06)
