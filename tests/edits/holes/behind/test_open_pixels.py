"""Where nothing stands behind a deleted thing, its gap stays open."""

import numpy as np
import pytest

from instdrive_core.edits.holes.behind.open_pixels import find_open_pixels

SIZE = (20, 30)
GAP = np.zeros(SIZE, bool)
GAP[4:16, 5:25] = True
NONE, NO_SKY = np.zeros(SIZE, np.int64), np.zeros(SIZE, bool)


def test_what_photos_look_through_stays_open():
    past, met = NONE.copy(), NONE.copy()
    past[:, :15], met[:, 15:] = 4, 4
    open_ = find_open_pixels(GAP, ~GAP, NO_SKY, past, met)
    assert (open_ == (GAP & (np.arange(SIZE[1]) < 15))).all()


def test_one_photo_that_misses_what_the_others_see_changes_nothing():
    met, past = np.full(SIZE, 3), NONE.copy()
    past[8, 12] = 5
    assert not find_open_pixels(GAP, ~GAP, NO_SKY, past, met).any()


def test_where_no_photo_tells_the_skyline_goes_on_from_the_rim():
    sky = np.zeros(SIZE, bool)
    sky[:10] = True
    open_ = find_open_pixels(GAP, ~GAP, sky, NONE, NONE)
    assert (open_ == (GAP & sky)).all()


def test_what_photos_tell_reaches_into_what_they_do_not_show():
    past = NONE.copy()
    past[4:10, 5:25] = 3
    rim = ~GAP & (np.arange(SIZE[0]) >= 16)[:, None]
    open_ = find_open_pixels(GAP, rim, NO_SKY, past, NONE)
    assert open_[:12, 5:25][4:].all()
    assert not open_[15].any()


@pytest.mark.parametrize(("votes", "stays"), [(30, True), (8, False)])
def test_no_crumbs_hang_in_the_open(votes, stays):
    past, met = np.full(SIZE, 4), NONE.copy()
    past[8:11, 14:17], met[8:11, 14:17] = 0, votes
    assert (not find_open_pixels(GAP, ~GAP, NO_SKY, past, met)[9, 15]) == stays


def test_among_walls_nothing_is_open():
    assert not find_open_pixels(GAP, ~GAP, NO_SKY, NONE, NONE).any()
