"""The drawn way of the recording car: its places, and what a project keeps of it."""

import numpy as np
import pytest

from instdrive_app.session.driving.ego_way import MOST, EgoWay


def test_places_are_set_moved_and_taken_away():
    way = EgoWay()
    assert not way.is_way
    assert len(way.find_line()) == 0
    for place in ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0)):
        way.add(*place)
    version = way.version
    way.move(1, 12.0, 0.0)
    assert way.places[1] == (12.0, 0.0)
    line = way.find_line()
    assert np.allclose(line[[0, -1]], [(0, 0), (10, 10)], atol=0.2)
    assert np.linalg.norm(line - (12.0, 0.0), axis=1).min() < 0.2
    way.drop_last()
    assert len(way.places) == 2
    assert way.version == version + 2
    assert way.build(4.0).speed == 4.0
    way.clear()
    assert way.places == ()


def test_a_project_keeps_it():
    way, other = EgoWay(), EgoWay()
    way.add(1.0, 2.0)
    way.add(3.0, 4.5)
    other.restore(way.store())
    assert other.places == way.places
    assert other.version == 0, "what was opened is saved already"


@pytest.mark.parametrize("stored", [None, "x", [[1.0]], [[1.0, float("nan")]], [[1.0, 2.0], {"x": 1}], [1, 2]])
def test_what_makes_no_sense_is_left_out(stored):
    way = EgoWay()
    way.restore(stored)
    assert way.places == ()


def test_it_turns_with_the_scene_and_has_an_end():
    way = EgoWay()
    way.add(1.0, 0.0)
    way.follow_scene(np.array([[0.0, -2.0, 0.0, 5.0], [2.0, 0.0, 0.0, 0.0], [0.0, 0.0, 2.0, 0.0]]))
    assert way.places == ((5.0, 2.0),)
    for number in range(MOST + 5):
        way.add(float(number), 0.0)
    assert len(way.places) == MOST
