"""Cells that share a corner hang together."""

import numpy as np

from instdrive_core.maths.cells import connect_cells


def test_corners_connect_and_gaps_do_not():
    cells = np.array([[0, 0, 0], [1, 1, 1], [5, 5, 5], [3, 1, 1], [5, 5, 6]])
    found = connect_cells(cells)
    assert found[0] == found[1] != found[2] == found[4]
    assert len(set(found.tolist())) == 3


def test_no_cells_no_components():
    assert connect_cells(np.zeros((0, 3), np.int64)).shape == (0,)
