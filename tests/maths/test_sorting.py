"""The depth sort equals numpy's stable argsort, whatever the values."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from instdrive_core.maths.sorting import back_to_front

DEPTHS = arrays(np.float32, st.integers(0, 200), elements=st.floats(-10, 1000, width=32))


@settings(deadline=None)  # the first call compiles
@given(DEPTHS, st.sampled_from([0.0, 0.2]))
def test_order_is_the_reversed_stable_argsort_of_rows_in_front(depths, near):
    kept = np.flatnonzero(depths > np.float32(near))
    expected = kept[np.argsort(depths[kept], kind="stable")][::-1]
    np.testing.assert_array_equal(back_to_front(depths, near), expected)


def test_rows_without_a_finite_depth_are_left_out():
    order = back_to_front(np.array([1, np.nan, np.inf, -np.inf, 3, -1], np.float32), 0.0)
    assert order.tolist() == [4, 0]
