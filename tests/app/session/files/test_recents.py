"""Recent files, and views that come back with a project."""

import numpy as np
import pytest

from instdrive_app.session.files.recents import MAX_RECENTS, RecentFiles
from instdrive_app.session.view_memory import restore_view, store_view
from instdrive_app.state import ViewMode


def test_the_newest_comes_first_and_what_is_gone_is_left_out(tmp_path):
    recents = RecentFiles(tmp_path / "state" / "recent.json")
    files = [tmp_path / f"{number}.ply" for number in range(MAX_RECENTS + 3)]
    for file in files:
        file.write_bytes(b"")
        recents.add(file)
    assert recents.paths == tuple(reversed(files[3:]))
    recents.add(files[5])
    assert recents.paths[0] == files[5]
    assert len(set(recents.paths)) == MAX_RECENTS
    files[5].unlink()
    assert RecentFiles(tmp_path / "state" / "recent.json").paths[0] == files[-1]
    recents.clear()
    assert recents.paths == ()


@pytest.mark.parametrize("content", [b"", b"nonsense", b'{"a": 1}', b"[1, null]", b"\xff\xfe"])
def test_a_damaged_list_is_an_empty_one(tmp_path, content):
    (tmp_path / "recent.json").write_bytes(content)
    recents = RecentFiles(tmp_path / "recent.json")
    assert recents.paths == ()
    recents.add(tmp_path)
    assert recents.paths == (tmp_path,)


def test_a_view_comes_back(session, street):
    session.navigation.look_from(session.state.viewpoint)
    session.state.view_mode, session.state.time = ViewMode.DEPTH, 1.0
    kept, pose = store_view(session.state), session.state.viewpoint.world_from_camera
    session.navigation.look_through(2)
    session.state.view_mode = ViewMode.COLOR
    assert restore_view(kept, session.state, session.navigation, len(street.scene.views))
    np.testing.assert_array_equal(session.state.viewpoint.world_from_camera, pose)
    assert (session.state.view_mode, session.state.time) == (ViewMode.DEPTH, 1.0)
    assert session.state.dataset_view is None
    session.navigation.look_through(3)
    kept = store_view(session.state)
    session.navigation.look_through(0)
    assert restore_view(kept, session.state, session.navigation, len(street.scene.views))
    assert session.state.dataset_view == 3


@pytest.mark.parametrize(
    "change",
    [
        {"view_mode": "X-RAY"},
        {"time": "soon"},
        {"time": float("nan")},
        {"world_from_camera": [[1, 2], [3, 4]]},
        {"world_from_camera": np.zeros((4, 4)).tolist()},
        {"lens": {}},
        {"lens": {"fx": -1, "fy": 1, "cx": 1, "cy": 1, "width": 1, "height": 1}},
        {"pivot_distance": None},
    ],
)
def test_what_does_not_fit_changes_nothing(session, street, change):
    before = store_view(session.state)
    assert not restore_view(before | change, session.state, session.navigation, len(street.scene.views))
    assert store_view(session.state) == before
