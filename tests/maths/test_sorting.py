"""The depth sorts equal numpy's stable argsort, whatever the values."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from instdrive_core.maths.sorting import sort_back_to_front, sort_front_to_back

DEPTHS = arrays(np.float32, st.integers(0, 200), elements=st.floats(-10, 1000, width=32))


@settings(deadline=None)  # the first call compiles
@given(DEPTHS, st.sampled_from([0.0, 0.2]))
def test_order_is_the_reversed_stable_argsort_of_rows_in_front(depths, near):
    kept = np.flatnonzero(depths > np.float32(near))
    expected = kept[np.argsort(depths[kept], kind="stable")][::-1]
    np.testing.assert_array_equal(sort_back_to_front(depths, near), expected)
    np.testing.assert_array_equal(sort_front_to_back(depths, near), expected[::-1])


def test_rows_without_a_finite_depth_are_left_out():
    order = sort_back_to_front(np.array([1, np.nan, np.inf, -np.inf, 3, -1], np.float32), 0.0)
    assert order.tolist() == [4, 0]


@pytest.mark.parametrize("count", [0, 1, 7, 3000, 70_000])
def test_rows_come_nearest_first_and_equal_depths_in_row_order(count):
    rng = np.random.default_rng(count)
    depths = (rng.gamma(2, 10, count) + 0.1).astype(np.float32)
    depths[rng.random(count) < 0.3] = 0
    depths[rng.random(count) < 0.2] = 2.5
    depths[rng.random(count) < 0.01] = rng.choice([np.nan, np.inf, -1.0])
    kept = np.flatnonzero((depths > 0) & (depths < np.inf))
    expected = kept[np.argsort(depths[kept], kind="stable")]
    np.testing.assert_array_equal(sort_front_to_back(depths), expected)


@pytest.mark.parametrize("extremes", [(1e-30, 1e30), (0.1, 0.1), (5.0, np.nextafter(np.float32(5), 6))])
def test_any_range_of_depths(extremes):
    depths = np.array([*extremes, *extremes[::-1]], np.float32)
    expected = np.argsort(depths, kind="stable")
    np.testing.assert_array_equal(sort_front_to_back(depths), expected)
