"""Rows by group: every row once, in order."""

import numpy as np

from instdrive_core.maths.groups import split_by_group


def test_groups_rise_and_rows_keep_their_order():
    groups = np.array([3, -1, 3, 0, 3], np.int64)
    assert [(group, rows.tolist()) for group, rows in split_by_group(groups)] == [(-1, [1]), (0, [3]), (3, [0, 2, 4])]


def test_only_the_rows_that_are_asked_for():
    groups = np.array([3, 1, 3, 1], np.uint32)
    assert [(group, rows.tolist()) for group, rows in split_by_group(groups, np.array([2, 3]))] == [(1, [3]), (3, [2])]
    assert split_by_group(groups, np.zeros(0, np.int64)) == []
