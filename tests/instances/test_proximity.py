"""Which points are near others, and how far points lie apart."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from instdrive_core.instances.proximity import estimate_spacing, find_rows_near


@settings(deadline=None)
@given(st.integers(0, 10_000), st.integers(0, 40), st.integers(0, 40), st.floats(0.01, 2.0))
def test_near_rows_are_those_of_all_pairs(seed, asked_count, other_count, distance):
    rng = np.random.default_rng(seed)
    points = rng.normal(0, 1, (80, 3)).astype(np.float32)
    order = rng.permutation(80)
    asked, others = np.sort(order[:asked_count]), np.sort(order[40 : 40 + other_count])
    apart = np.linalg.norm(points[asked, None].astype(np.float64) - points[None, others], axis=2)
    expected = asked[(apart <= distance).any(axis=1)] if other_count else asked[:0]
    np.testing.assert_array_equal(find_rows_near(points, asked, others, distance), expected)


def test_points_that_are_not_finite_are_near_nothing():
    points = np.zeros((5, 3), np.float32)
    points[1, 0], points[2, 1] = np.nan, np.inf
    found = find_rows_near(points, np.array([0, 1, 2]), np.array([1, 2, 3]), 1.0)
    assert found.tolist() == [0]


@pytest.mark.parametrize("count", [40, 400])
def test_spacing_of_a_grid_is_its_diagonal_however_many_points(count):
    x, y = np.meshgrid(np.arange(count), np.arange(count))
    grid = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1).astype(np.float32) * 0.1
    # Of 160,000 points a sixth is looked at.
    points = grid[np.random.default_rng(0).permutation(len(grid))]
    assert estimate_spacing(points) == pytest.approx(0.1414, rel=0.25)


def test_too_few_points_have_no_spacing():
    assert estimate_spacing(np.zeros((6, 3), np.float32)) == np.inf
    assert estimate_spacing(np.full((20, 3), np.nan, np.float32)) == np.inf
