"""Keys of ways in the session: dragged as one step, added, deleted, given to what is parked, and undone."""

from dataclasses import replace

import numpy as np
import pytest
from procedural_street import DRIVING_CAR, FIRST_CAR, ROAD

from instdrive_app.session.driving.path_hits import find_key_at, find_on_ground, measure_to_way
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.scene.ways.way_keys import move_key, retime_key


@pytest.fixture
def ways(session):
    """The driving car, with the path tool in the hand."""
    session.state.tool = "path"
    session.selection.select((DRIVING_CAR,))
    return session.ways


def places(keys):
    return [(key.time, key.x, key.y) for key in keys]


def test_a_drag_is_one_step_and_its_keys_stay_as_they_were_set(session, street, ways):
    first = ways.keys
    assert len(first) == 2, "a straight drive has two keys"
    steps = street.history.cursor
    for x in (2.0, 2.5, 3.0):
        ways.preview(move_key(ways.keys, 1, x, 20.0))
        assert ways.is_dragging
    ghost = ways.find_ghost()
    assert ghost is not None
    assert np.allclose(ghost.mean(axis=0), (1.2, 9.0))
    ways.finish()
    assert street.history.cursor == steps + 1
    assert (ways.keys[1].x, ways.keys[1].y) == (3.0, 20.0)
    track = street.scene.actors[0]
    assert np.allclose(track.interpolate_pose(float(track.times[-1]))[:2, 3], (3.0, 20.0), atol=1e-6)
    session.undo()
    assert places(ways.keys) == places(first)
    session.redo()
    assert (ways.keys[1].x, ways.keys[1].y) == (3.0, 20.0)
    street.apply(MoveInstances((DRIVING_CAR,), (0.0, 5.0, 0.0)))
    assert ways.keys[1].y == pytest.approx(25.0, abs=0.2), "a move of the whole drive moves its keys"


def test_a_drag_that_is_given_up_changes_nothing(street, ways):
    steps, first = street.history.cursor, ways.keys
    ways.preview(retime_key(ways.keys, 1, 3.0))
    ways.cancel()
    ways.finish()
    assert (street.history.cursor, ways.keys) == (steps, first)


def test_keys_are_added_deleted_and_retimed(session, ways):
    ways.add(2.0)
    assert len(ways.keys) == 3
    assert ways.chosen == 1
    ways.preview(retime_key(ways.keys, 1, 3.0))
    ways.finish()
    assert ways.keys[1].time == 3.0
    assert session.actions.run("way.delete")
    assert len(ways.keys) == 2


def test_a_parked_car_drives_where_it_is_sent(session, street, ways):
    session.selection.select((FIRST_CAR,))
    assert ways.subject == FIRST_CAR
    assert not ways.drives
    session.state.time = 0.5
    ways.extend(-1.0, 14.0)
    assert FIRST_CAR not in street.find_visible_instances()
    assert ways.subject not in (0, FIRST_CAR)
    assert ways.drives
    assert ways.keys[0].time == 0.5
    ways.extend(-1.0, 20.0)
    assert len(ways.keys) == 3
    track = street.scene.actors[-1]
    assert np.allclose(track.interpolate_pose(float(track.times[-1]))[:2, 3], (-1.0, 20.0), atol=1e-6)
    session.undo()
    session.undo()
    assert FIRST_CAR in street.find_visible_instances()


def test_ground_and_several_things_have_no_way(session, ways):
    session.selection.select((ROAD,))
    assert ways.subject == 0
    session.selection.select((FIRST_CAR, FIRST_CAR + 1))
    assert ways.subject == 0
    assert ways.keys == ()


def test_keys_lie_on_sloping_ground(session, street, ways):
    track = street.scene.actors[0]
    poses = track.world_from_box.copy()
    poses[:, 2, 3] += 0.5 * track.times
    street.replace_tracks({1: replace(track, world_from_box=poses)})
    first, last = ways.find_places()[[0, -1]]
    assert first[2] == pytest.approx(0.0)
    assert last[2] == pytest.approx(2.0)
    assert (np.diff(ways.find_line()[:, 2]) >= 0).all()


def test_the_mouse_finds_keys_and_the_way(session, ways):
    session.navigation.look_down((DRIVING_CAR,))
    camera = session.state.viewpoint.fit_camera(1280, 720)
    key, height = ways.keys[0], ways.find_ground()
    spot = camera.project(np.array([[key.x, key.y, height]]))[0][0]
    assert find_key_at(ways, camera, *spot) == 0
    assert find_key_at(ways, camera, spot[0] + 60, spot[1]) is None
    assert find_on_ground(camera, height, *spot) == pytest.approx((key.x, key.y))
    between = camera.project(np.array([[1.2, 12.0, height]]))[0][0]
    assert measure_to_way(ways, camera, *between) < 1.0
    assert measure_to_way(ways, camera, between[0] + 30, between[1]) == pytest.approx(30, abs=2)
