"""Films exported from the editor: what is shown is filmed, and what cannot be is said."""

import sys

import numpy as np
import pytest
from PIL import Image
from procedural_street import FIRST_CAR
from session_driver import finish

from instdrive_app.messages import Level
from instdrive_app.session.export_kinds import ExportChoice
from instdrive_core.filming.film import FilmSettings
from instdrive_core.filming.path_file import read_camera_path
from instdrive_core.instances.colormap import ids_from_colors

SMALL = FilmSettings(96, 54, 2.0, "instance")


@pytest.fixture
def path(session):
    """One second between the first camera's view and the last one's."""
    session.camera_path.add()
    session.navigation.look_through(len(session.document.scene.views) - 1)
    session.camera_path.add()
    session.camera_path.move(1, 1.0)
    return session.camera_path


def export(session, path, film=SMALL):
    finish(session)
    session.export.begin("film")
    session.export.write(path, ExportChoice("film", film=film))
    finish(session)
    return session.messages.log[-1]


def read_ids(path):
    with Image.open(path) as picture:
        return ids_from_colors(np.asarray(picture))


def test_hidden_instances_are_not_in_the_film(session, path, tmp_path):
    assert export(session, tmp_path / "all").text == f"Exported a film of 3 frames to {tmp_path / 'all'}"
    session.visibility.hide((FIRST_CAR,))
    export(session, tmp_path / "without")
    seen, left = ({*np.unique(read_ids(tmp_path / name / "frame_00001.png"))} for name in ("all", "without"))
    assert FIRST_CAR in seen
    assert FIRST_CAR not in left
    assert left & seen - {0}


def test_keys_are_exported_for_the_command_line(session, path, tmp_path):
    assert "Exported the 2 keys" in export(session, tmp_path / "keys.json").text
    assert [key.at for key in read_camera_path(tmp_path / "keys.json")] == [0.0, 1.0]
    assert session.export.amounts["film"] == "2 keys, 1.0 s"


def test_what_cannot_be_filmed_is_said_before_anything_is_drawn(session, path, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)
    told = export(session, tmp_path / "film.mp4")
    assert told.level is Level.ERROR
    assert "instdrive[video]" in told.text
    assert "even number" in export(session, tmp_path / "film.webm", FilmSettings(95, 54)).text
    assert not list(tmp_path.iterdir())
    assert export(session, tmp_path / "frames").level is Level.INFO, "frames need no package"


def test_a_path_without_keys_has_nothing_to_film(session):
    session.export.begin("film")
    assert session.export.amounts["film"] == ""
    assert not session.actions["path.film"].enabled()


@pytest.mark.parametrize("name", ["film", "film.mp4", "film.json"])
def test_without_keys_nothing_is_written(session, tmp_path, name):
    said = export(session, tmp_path / name)
    assert said.level is Level.ERROR
    assert "no keys; add views to it with Shift+K" in said.text
    assert not (tmp_path / name).exists()
