"""Lane marks are bright and narrow, and lie on the road."""

import numpy as np

from instdrive_core.edits.holes.lanes.lane_marks import continue_marks, find_lane_marks


def test_a_line_is_a_mark_but_neither_a_pavement_nor_a_patch_in_the_sun_is() -> None:
    brightness, height = np.full((40, 60), 0.4), np.zeros((40, 60))
    brightness[:, 20] = 0.7
    brightness[:, 30:45] = 0.6  # in the sun
    brightness[:, 50:], height[:, 50:] = 0.65, 0.12
    known = np.ones((40, 60), bool)
    marks = find_lane_marks(brightness, height, known, 0.2)
    assert set(np.flatnonzero(marks.any(axis=0)).tolist()) == {20}
    assert marks[:, 20].all()


def test_a_line_is_one_at_the_edge_of_what_is_known_but_a_strip_of_pavement_is_none() -> None:
    brightness, height = np.full((40, 60), 0.4), np.zeros((40, 60))
    brightness[:, 20] = 0.7
    known = np.broadcast_to(np.arange(60) <= 20, (40, 60))
    assert find_lane_marks(brightness, height, known, 0.2)[:, 20].all()
    height[:, 20] = 0.12
    assert not find_lane_marks(brightness, height, known, 0.2).any()


def test_nothing_known_has_no_marks() -> None:
    nothing = np.zeros((10, 10), bool)
    assert not find_lane_marks(np.ones((10, 10)), np.zeros((10, 10)), nothing, 0.2).any()


def test_a_line_goes_on_through_a_hole_and_dashes_do_not() -> None:
    known, hole = np.ones((60, 30), bool), np.zeros((60, 30), bool)
    hole[20:40, 10:28] = True
    marks = np.zeros((60, 30), bool)
    marks[:, 17] = True
    marks[:4, 22] = marks[56:, 22] = True
    sources = np.where(hole[..., None], 0, -1) * np.ones(2, int)
    found = continue_marks(sources, marks, known & ~hole, hole, 0.2)
    assert (found[20:40, 17, 1] == 17).all()
    rows = found[20:40, 17, 0]
    assert (known & ~hole)[rows, 17].all()
    assert rows[:10].tolist() == list(range(18, 8, -1))  # 19 mirrors itself
    assert rows[10:].tolist() == list(range(50, 40, -1))
    others = np.arange(30) != 17
    assert (found[:, others] == sources[:, others]).all()
