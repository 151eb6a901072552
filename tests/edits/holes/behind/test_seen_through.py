"""Photos tell at which places nothing stands, as they were taken."""

import numpy as np
import pytest
from parked_street import CAR, parked_street

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.holes.behind.seen_through import PhotoDepths
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.kinds.turn_scene import TurnScene


@pytest.fixture
def document():
    return Document(parked_street().scene)


def test_photos_look_through_the_air_and_meet_the_wall(document):
    points = np.array([[3.0, -5.0, 1.5], [6.0, -5.0, 1.0]])
    past, met = PhotoDepths(document).count_votes(points)
    assert past[0] >= 3
    assert met[0] == 0
    assert met[1] >= 3
    assert past[1] == 0


def test_photos_tell_nothing_of_what_stands_behind_a_wall(document):
    past, met = PhotoDepths(document).count_votes(np.array([[12.0, -5.0, 0.8]]))
    assert (past[0], met[0]) == (0, 0)


def test_a_deleted_car_still_hid_what_is_behind_it(document):
    middle = document.scene.gaussians.means[document.find_rows((CAR,))].astype(np.float64).mean(axis=0)
    behind = middle[None] + np.array([1.8, 0.0, 0.0])
    before = PhotoDepths(document).count_votes(behind)
    document.apply(DeleteInstances((CAR,)))
    after = PhotoDepths(document).count_votes(behind)
    np.testing.assert_array_equal(before, after)


def test_no_places_have_no_votes(document):
    past, met = PhotoDepths(document).count_votes(np.zeros((0, 3)))
    assert len(past) == len(met) == 0


def test_a_scene_that_was_turned_tells_the_same(document):
    points = np.array([[3.0, -5.0, 1.5], [6.0, -5.0, 1.0]])
    before = PhotoDepths(document).count_votes(points)
    turn = TurnScene((0.9, 0.1, 0.2, 0.3), 1.0)
    document.apply(turn)
    np.testing.assert_array_equal(PhotoDepths(document).count_votes(points @ turn.linear.T), before)
