"""Keys of the camera's path: added, moved, deleted, played, and kept by a project."""

import json

import numpy as np
import pytest

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


def test_keys_move_between_their_neighbours(path):
    path.move(1, 9.0)
    assert [key.at for key in path.keys] == [0.0, 2 * GAP - CLOSEST, 2 * GAP]
    path.move(2, 30.0)
    assert path.end == 30.0
    path.move(0, -5.0)
    assert path.keys[0].at == 0.0


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
