"""Scratch arrays that are kept from frame to frame."""

import numpy as np

from instdrive_core.maths.workspace import Workspace


def test_arrays_of_a_workspace_are_kept_grow_and_begin_with_a_cache_line():
    workspace = Workspace()
    first = workspace.get_array("a", (10, 3))
    first[:] = 7
    again = workspace.get_array("a", (30,))
    assert np.shares_memory(first, again)
    np.testing.assert_array_equal(again, 7)
    assert not np.shares_memory(first, workspace.get_array("b", (30,)))
    grown = workspace.get_array("a", (4000, 4), np.float32)
    assert grown.ctypes.data % 64 == 0
    assert workspace.get_size("a") >= 16_000
    assert workspace.get_size("c") == 0
    assert workspace.get_array("a", (5,), np.int64).dtype == np.int64
