"""Views that the user keeps."""

import json

import numpy as np
import pytest

from instdrive_app.camera import orbit
from instdrive_app.session.aids.bookmarks import MOST, THUMBNAIL, Bookmarks
from instdrive_app.state import make_default_viewpoint

START = make_default_viewpoint()
SIDE = orbit(START, 0.7, 0.1)


@pytest.fixture
def bookmarks():
    made = Bookmarks()
    made.keep(START, 0.0)
    made.keep(SIDE, 1.5)
    return made


def test_views_come_back_from_a_project_with_their_pictures(bookmarks):
    picture = np.full((300, 800, 3), (200, 40, 40), np.uint8)
    assert bookmarks.find_pictureless(SIDE.world_from_camera, 1.5) == 1
    assert bookmarks.find_pictureless(SIDE.world_from_camera, 0.0) is None
    bookmarks.set_thumbnail(1, picture)
    bookmarks.rename(1, "  the side\n ")
    found = Bookmarks()
    found.restore(json.loads(json.dumps(bookmarks.store())))
    assert [kept.name for kept in found.kept] == ["View 1", "the side"]
    assert found.kept[1].time == 1.5
    assert np.array_equal(found.kept[1].viewpoint.world_from_camera, SIDE.world_from_camera)
    assert found.kept[0].thumbnail is None
    small = found.kept[1].thumbnail
    assert small is not None
    assert small.shape == (72, THUMBNAIL[0], 4)
    assert np.abs(small[..., :3].astype(int) - (200, 40, 40)).max() < 12
    assert found.version == 0, "what was just read is saved"


@pytest.mark.parametrize(
    "damage",
    [
        None,
        {"name": 3},
        {"time": float("nan")},
        {"world_from_camera": [[1, 2], [3, 4]]},
        {"lens": {}},
        {"zoom": 0},
        {"name": "line\nbreak"},
    ],
)
def test_damaged_entries_are_left_out(bookmarks, damage):
    stored = bookmarks.store()
    stored[0] = None if damage is None else stored[0] | damage
    bookmarks.restore(stored)
    assert [kept.name for kept in bookmarks.kept] == ["View 2"]
    bookmarks.restore({"name": "no list"})
    assert not len(bookmarks)


@pytest.mark.parametrize("picture", ["no base64!", "AAAA", 17])
def test_a_damaged_picture_is_taken_again(bookmarks, picture):
    bookmarks.restore([entry | {"thumbnail": picture} for entry in bookmarks.store()])
    assert bookmarks.find_pictureless(START.world_from_camera, 0.0) == 0


def test_deleting_and_keeping_give_free_names_and_count_as_changes(bookmarks):
    before = bookmarks.version
    bookmarks.delete(0)
    assert bookmarks.current == 0
    assert bookmarks.keep(START, 0.0).name == "View 1"
    bookmarks.rename(0, "   ")
    assert bookmarks.kept[0].name == "View 2"
    assert bookmarks.version == before + 2
    for _ in range(MOST - 2):
        assert bookmarks.keep(START, 0.0) is not None
    assert bookmarks.keep(START, 0.0) is None


def test_kept_views_follow_a_turned_scene(session):
    session.actions.run("view.keep")
    before = session.aids.bookmarks.kept[0].viewpoint.position
    session.orientation.turn(np.array([0.0, 0.0, 1.0]), 2.0)
    session.tick(0.01)
    assert np.allclose(session.aids.bookmarks.kept[0].viewpoint.position, 2 * before)


def test_commands_go_through_the_kept_views(session):
    session.actions.run("view.keep")
    first = session.state.viewpoint
    session.navigation.look_from(SIDE)
    session.actions.run("view.keep")
    assert session.files.is_unsaved
    session.actions.run("view.next_kept")
    assert np.array_equal(session.state.viewpoint.world_from_camera, first.world_from_camera)
    session.actions.run("view.previous_kept")
    assert session.state.viewpoint is SIDE
    session.actions.run("view.delete_kept")
    assert [kept.name for kept in session.aids.bookmarks.kept] == ["View 1"]
    assert [title for title, _ in session.actions["view.kept"].items()] == ["View 1"]
