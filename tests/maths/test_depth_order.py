"""The parallel sort of depths against numpy's."""

import numpy as np
import pytest

from instdrive_core.maths.depth_order import nearest_first
from instdrive_core.maths.workspace import Workspace


@pytest.mark.parametrize("count", [0, 1, 7, 3000, 70_000])
def test_rows_come_nearest_first_and_equal_depths_in_row_order(count):
    rng, workspace = np.random.default_rng(count), Workspace()
    for _ in range(2):  # the second time in used memory
        depths = (rng.gamma(2, 10, count) + 0.1).astype(np.float32)
        depths[rng.random(count) < 0.3] = 0
        depths[rng.random(count) < 0.2] = 2.5
        depths[rng.random(count) < 0.01] = rng.choice([np.nan, np.inf, -1.0])
        kept = np.flatnonzero((depths > 0) & (depths < np.inf))
        expected = kept[np.argsort(depths[kept], kind="stable")]
        np.testing.assert_array_equal(nearest_first(depths, workspace), expected)


@pytest.mark.parametrize("extremes", [(1e-30, 1e30), (0.1, 0.1), (5.0, np.nextafter(np.float32(5), 6))])
def test_any_range_of_depths(extremes):
    depths = np.array([*extremes, *extremes[::-1]], np.float32)
    expected = np.argsort(depths, kind="stable")
    np.testing.assert_array_equal(nearest_first(depths, Workspace()), expected)


def test_arrays_of_a_workspace_are_kept_grow_and_begin_with_a_cache_line():
    workspace = Workspace()
    first = workspace.array("a", (10, 3))
    first[:] = 7
    again = workspace.array("a", (30,))
    assert np.shares_memory(first, again)
    np.testing.assert_array_equal(again, 7)
    assert not np.shares_memory(first, workspace.array("b", (30,)))
    grown = workspace.array("a", (4000, 4), np.float32)
    assert grown.ctypes.data % 64 == 0
    assert workspace.size("a") >= 16_000
    assert workspace.size("c") == 0
    assert workspace.array("a", (5,), np.int64).dtype == np.int64
