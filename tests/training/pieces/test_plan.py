"""Where drives are cut."""

from itertools import pairwise

import numpy as np
import pytest

from instdrive_core.errors import OptionError
from instdrive_core.training.pieces.plan import (
    DriveStep,
    count_pieces,
    describe_pieces,
    measure_drive,
    plan_pieces,
)


def drive(steps, metres=0.7, photos=6, first=0, ways=None):
    """Time steps along x; every tenth has no training photo."""
    ways = np.full(steps, metres) if ways is None else np.asarray(ways, float)
    places = np.cumsum(ways) - ways[0]
    return [
        DriveStep(first + k, np.array([places[k], 0.0, 1.5]), 0 if (first + k) % 10 == 4 else photos)
        for k in range(steps)
    ]


@pytest.mark.parametrize(
    ("steps", "metres", "photos"),
    [(80, 0.7, 6), (80, 3.0, 6), (30, 0.7, 6), (100, 0.0, 6), (200, 0.7, 1), (80, 1.5, 6)],
    ids=["the paper's unit", "on a motorway", "short", "standing", "one camera", "faster"],
)
def test_what_one_run_is_made_for_is_one_piece(steps, metres, photos):
    assert count_pieces(measure_drive(drive(steps, metres, photos))) == 1


def test_a_long_drive_is_cut_into_pieces_of_about_sixty_metres():
    steps = drive(300)
    count = count_pieces(measure_drive(steps))
    pieces = plan_pieces(steps, count)
    assert count == len(pieces) == 4
    assert all(50 < piece.metres < 80 for piece in pieces)
    assert describe_pieces(209.3, pieces).startswith("drive of 209 m: 4 pieces of ~60 m")


def test_little_memory_makes_more_pieces():
    size = measure_drive(drive(300))
    assert count_pieces(size, affordable_photos=200) == 9
    assert count_pieces(measure_drive(drive(80)), affordable_photos=200) == 2


def test_a_drive_that_stands_still_is_not_cut():
    assert count_pieces(measure_drive(drive(300, 0.01))) == 1


@pytest.mark.parametrize("count", [2, 3, 4, 7, 20])
@pytest.mark.parametrize("first", [0, 37])
def test_cores_are_the_drive_and_neighbours_overlap(count, first):
    rng = np.random.default_rng(count)
    steps = drive(120, ways=rng.uniform(0, 1.5, 120), first=first)
    pieces = plan_pieces(steps, count)
    cores = [index for piece in pieces for index in range(piece.core_first, piece.core_last + 1)]
    assert cores == [step.index for step in steps]
    assert (pieces[0].first, pieces[-1].last) == (first, first + 119)
    for one, other in pairwise(pieces):
        assert other.first <= one.core_last < other.core_first <= one.last
    for piece, after in zip(pieces[:-2], pieces[2:], strict=True):
        assert piece.last < after.first, "no photo is trained three times"


def test_pieces_are_of_like_length_whatever_the_speed():
    steps = drive(200, ways=np.r_[np.full(100, 0.4), np.full(100, 1.6)])
    lengths = [piece.metres for piece in plan_pieces(steps, 4)]
    assert max(lengths) < 2.5 * min(lengths)


def test_no_border_lies_where_the_car_waits():
    ways = np.r_[np.full(100, 0.7), np.zeros(100), np.full(100, 0.7)]
    border = plan_pieces(drive(300, ways=ways), 2)[1].core_first
    assert ways[border] > 0


def test_too_many_pieces_are_refused():
    with pytest.raises(OptionError, match="--pieces is 6; 10 time steps can be cut into 1 to 5"):
        plan_pieces(drive(10), 6)
    with pytest.raises(OptionError, match="--pieces is 0"):
        plan_pieces(drive(10), 0)
