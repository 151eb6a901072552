"""Keys of the camera's path: added, moved, deleted, played, and kept by a project."""

import json

import numpy as np
import pytest
from procedural_street import FIRST_CAR

from instdrive_app.camera import orbit
from instdrive_app.session.showing.path_controller import GAP
from instdrive_core.filming.camera_path import CLOSEST


@pytest.fixture
def path(session):
    """Three keys, two seconds apart, around the street."""
    for _ in range(3):
        session.camera_path.add()
        session.navigation.look_from(orbit(session.state.viewpoint, 0.4, 0.1))
    return session.camera_path


def test_keys_come_one_after_the_other_and_between(session, path):
    assert [key.at for key in path.keys] == [0.0, GAP, 2 * GAP]
    path.seek(1.0)
    path.add()
    assert [key.at for key in path.keys] == [0.0, 1.0, GAP, 2 * GAP]
    assert path.chosen == 1
    assert np.allclose(path.keys[1].camera.world_from_camera, session.state.viewpoint.world_from_camera)


def test_keys_move_past_others_and_never_too_close(path):
    moved = path.keys[1]
    assert path.move(1, 9.0) == 2
    assert [key.at for key in path.keys] == [0.0, 2 * GAP, 9.0]
    assert path.keys[2].camera is moved.camera
    assert path.chosen == 2
    assert path.move(2, 2 * GAP - 0.01) == 1
    assert path.keys[1].at == pytest.approx(2 * GAP - CLOSEST)
    assert path.move(1, -5.0) == 1
    assert [key.at for key in path.keys] == [0.0, CLOSEST, 2 * GAP]
    assert path.move(7, 1.0) == 7, "a key that is gone is not moved"


def test_changes_of_the_path_are_undone_in_one_order_with_edits(session, path, street):
    before = path.keys
    assert session.actions.run("edit.undo")
    assert path.keys == before[:2]
    session.redo()
    assert path.keys == before
    session.selection.select((FIRST_CAR,))
    session.deletion.delete_selection()
    path.go_to_key(1)
    path.delete()
    steps = street.history.cursor
    session.undo()
    assert (path.keys, street.history.cursor) == (before, steps)
    session.undo()
    assert (path.keys, street.history.cursor) == (before, steps - 1), "then the edit that came before"
    session.redo()
    assert street.history.cursor == steps
    session.redo()
    assert path.keys == (before[0], before[2])
    session.undo()
    session.selection.select((FIRST_CAR + 1,))
    session.undo()
    session.redo()
    assert path.keys == before, "what was undone before another edit is not done again"
    assert street.find_selected_instances() == (FIRST_CAR + 1,)


def test_a_drag_is_one_step(session, path):
    before = path.keys
    for at in (2.5, 3.0, 5.5):
        path.move(path.chosen if at > 2.5 else 1, at, "drag 1")
    path.move(0, 1.0, "drag 2")
    session.undo()
    assert [key.at for key in path.keys] == [0.0, 2 * GAP, 5.5]
    session.undo()
    assert path.keys == before


def test_a_choice_outlives_no_key(session, path):
    path.go_to_key(2)
    session.undo()
    path.replace()
    path.delete()
    path.go_to_key(2)
    assert len(path.keys) == 2
    assert path.chosen is None


def test_a_preview_ends_where_the_user_looks_elsewhere(session, path):
    path.seek(0.0)
    path.toggle_playing()
    session.tick(0.5)
    assert path.playing
    mine = orbit(session.state.viewpoint, 0.3, 0.0)
    session.navigation.look_from(mine)
    session.tick(0.5)
    assert not path.playing
    assert session.state.viewpoint is mine


def test_keys_are_replaced_and_deleted(session, path):
    path.go_to_key(0)
    first = session.state.viewpoint.world_from_camera
    session.navigation.look_from(orbit(session.state.viewpoint, 1.0, 0.0))
    path.replace()
    assert not np.allclose(path.keys[0].camera.world_from_camera, first)
    path.delete()
    assert len(path.keys) == 2
    assert path.chosen == 0
    path.delete()
    path.delete()
    assert path.keys == ()
    assert path.chosen is None


def test_a_preview_passes_the_keys_and_ends_at_the_last(session, path):
    path.seek(path.end)
    path.toggle_playing()
    assert path.playhead == 0.0
    session.tick(GAP)
    middle = path.keys[1].camera.world_from_camera
    assert np.allclose(session.state.viewpoint.world_from_camera, middle, atol=1e-9)
    session.tick(1000.0)
    assert not path.playing
    assert np.allclose(session.state.viewpoint.world_from_camera, path.keys[2].camera.world_from_camera, atol=1e-9)


def test_a_project_keeps_the_path(session, path, street):
    assert session.files.is_unsaved
    stored = json.loads(json.dumps(path.store()))
    kept = path.keys
    session.show(street)
    assert path.keys == ()
    assert not session.files.is_unsaved
    path.restore(stored)
    assert [key.at for key in path.keys] == [key.at for key in kept]
    assert path.version == 0, "what was just read is saved"
    path.restore([{"at": "soon"}])
    assert path.keys == ()
