"""The carriageway goes on below pavements, as high as before the kerb."""

import numpy as np
import pytest

from instdrive_core.edits.holes.ground_grid import GroundGrid
from instdrive_core.edits.holes.ground_map import GroundMap
from instdrive_core.edits.holes.lanes.carriageway import follow_carriageway, measure_rise

SHAPE, SIZE = (120, 70), 0.2
ACROSS = SIZE * np.arange(SHAPE[1])
"""Metres."""


def make_street(kerb=0.08):
    """A road that is cambered, between pavements."""
    rng = np.random.default_rng(3)
    camber = 0.02 * np.abs(ACROSS - 7) - 0.05
    pavement = (ACROSS < 3) | (ACROSS > 10.6)
    height = np.broadcast_to(camber + kerb * pavement, SHAPE) + rng.normal(0, 0.03, SHAPE)
    return height, camber, pavement


@pytest.mark.parametrize("kerb", [0.07, 0.15])
def test_pavements_rise_above_a_cambered_road_by_their_kerbs(kerb):
    height, camber, pavement = make_street(kerb)
    levels = follow_carriageway(height, np.ones(SHAPE, bool), SIZE)
    assert levels[:, ~pavement] == pytest.approx(np.broadcast_to(camber, SHAPE)[:, ~pavement], abs=0.03)
    rise = (height - levels).mean(axis=0)
    assert rise[pavement].min() > 0.045
    assert rise[~pavement].max() < 0.03


def test_a_strip_of_which_nothing_is_known_hides_no_kerb():
    height, _, pavement = make_street()
    known = np.broadcast_to((ACROSS < 8) | (ACROSS > 11), SHAPE)
    rise = (height - follow_carriageway(height, known, SIZE)).mean(axis=0)
    assert rise[pavement & (ACROSS > 11)].min() > 0.045


def test_pavements_that_are_most_of_what_is_known_are_not_taken_for_the_road():
    height, _, pavement = make_street()
    known = np.random.default_rng(4).random(SHAPE) < np.where(pavement, 0.9, 0.5)
    rise = (height - follow_carriageway(height, known, SIZE)).mean(axis=0)
    assert rise[pavement].min() > 0.045


def test_nothing_known_is_level():
    nothing = np.zeros(SHAPE, bool)
    assert not follow_carriageway(np.ones(SHAPE), nothing, SIZE).any()


def test_whole_lines_say_what_lies_above_a_kerb():
    height, _, pavement = make_street(0.1)
    nothing = np.zeros(SHAPE, bool)
    grid = GroundGrid((0.0, 0.0), (0.0, 1.0), SIZE, SHAPE, (0.0, 0.0, 0.0))
    ground = GroundMap(grid, np.ones(SHAPE), np.ones((*SHAPE, 3)), height, nothing, np.zeros(0, bool))
    rise = measure_rise(ground, ~nothing)
    assert (rise[:, pavement] > 0.05).all()
    assert (rise[:, ~pavement] < 0.05).all()
    assert (height[:, ~pavement] > 0.05).any(), "single cells do not say it"
