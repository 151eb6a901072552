"""Pictures of the view: size, content, names, transparency."""

import time

import numpy as np
import pytest
from PIL import Image

from instdrive_app.state import ViewMode
from instdrive_core.edits.kinds.delete import DeleteInstances


@pytest.fixture
def pictures(tmp_path, monkeypatch):
    """The user's folder of pictures."""
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("XDG_CONFIG_HOME", raising=False)
    (tmp_path / "Pictures").mkdir()
    return tmp_path / "Pictures"


def take(session, *ids):
    for name in ids:
        assert session.actions.run(name)
    while session.jobs.current is not None:
        session.tick(0.01)
        time.sleep(0.01)


def test_pictures_have_the_size_of_the_view_and_names_of_their_own(session, pictures):
    session.state.picture_size = (160, 90)
    take(session, "view.screenshot", "view.screenshot_2x")
    first, second = (np.array(Image.open(pictures / f"scene_00{number}.png")) for number in (1, 2))
    assert first.shape == (90, 160, 3)
    assert second.shape == (180, 320, 3)
    assert first.std() > 5, "something is to be seen"
    halves = second.reshape(90, 2, 160, 2, 3).mean(axis=(1, 3))
    assert np.abs(halves - first).mean() < 12, "both show the same"
    assert str(pictures / "scene_002.png") in session.messages.log[-1].text


def test_a_picture_shows_edits_and_leaves_the_background_out(session, pictures):
    session.state.picture_size = (80, 60)
    take(session, "view.transparent", "view.screenshot")
    before = np.array(Image.open(pictures / "scene_001.png"))
    assert before.shape == (60, 80, 4)
    ids = tuple(instance.id for instance in session.document.scene.table)
    session.history.apply(DeleteInstances(ids))
    take(session, "view.screenshot")
    after = np.array(Image.open(pictures / "scene_002.png"))
    assert before[..., 3].max() > 200
    assert (after[..., 3] < before[..., 3]).any()
    session.state.view_mode = ViewMode.INSTANCE
    take(session, "view.screenshot")
    assert set(np.unique(np.array(Image.open(pictures / "scene_003.png"))[..., 3])) <= {0, 255}


def test_what_cannot_be_saved_is_told_and_its_name_is_free_again(session, pictures):
    session.state.picture_size = (30_000, 20_000)
    take(session, "view.screenshot")
    assert "too large" in session.messages.log[-1].text
    session.state.picture_size = (16, 16)
    take(session, "view.screenshot")
    assert (pictures / "scene_001.png").is_file()
