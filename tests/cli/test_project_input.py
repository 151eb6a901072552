"""Commands take projects as they take scenes, and `instdrive apply` writes them."""

import numpy as np
import pytest
from random_scene import assert_same_scene, random_scene

from instdrive_app.main import main
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.formats.registry import open_scene, save_scene
from instdrive_core.project.open import open_document


@pytest.fixture
def project(tmp_path, monkeypatch):
    """A project that deletes instance 2 and inserts a file named relative to where the command ran."""
    save_scene(tmp_path / "run", random_scene())
    save_scene(tmp_path / "car", random_scene(seed=1, count=12, instances=1, actors=0))
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "a.instdrive"
    assert main(["apply", "run", "--insert", "car", "--delete", "2", "-o", str(path)]) == 0
    monkeypatch.chdir("/")
    return path


def test_apply_goes_on_where_the_project_ends(project, tmp_path, capsys):
    assert main(["apply", str(project), "--delete", "3", "-o", str(tmp_path / "b.instdrive")]) == 0
    assert "3 edits of" in capsys.readouterr().out
    document, _ = open_document(tmp_path / "b.instdrive")
    assert [edit.kind for edit in document.history.done] == ["insert_scene", "delete_instances", "delete_instances"]
    assert main(["apply", str(project), "--delete", "3", "-o", str(tmp_path / "out")]) == 0
    assert_same_scene(open_scene(tmp_path / "out"), bake_document(document))


def test_a_project_takes_no_folder_of_tracks(project, tmp_path, capsys):
    assert main(["convert", str(project), str(tmp_path / "converted"), "--data", str(tmp_path)]) == 2
    assert "is a project, which has its tracks already" in capsys.readouterr().err


def test_convert_info_and_render_show_what_the_edits_made(project, tmp_path, capsys):
    assert main(["convert", str(project), str(tmp_path / "converted")]) == 0
    converted = open_scene(tmp_path / "converted")
    assert 2 not in converted.table
    assert len(converted) == len(random_scene()) + 12 - int(np.sum(random_scene().instance_ids == 2))
    capsys.readouterr()
    assert main(["info", str(project)]) == 0
    assert f"{len(converted):,}" in capsys.readouterr().out
    picture = tmp_path / "p.png"
    assert main(["render", str(project), "--view", "orbit", "--width", "64", "-o", str(picture)]) == 0
    assert picture.read_bytes()[:4] == b"\x89PNG"


def test_a_project_is_no_format_to_convert_into(project, tmp_path, capsys):
    assert main(["convert", str(tmp_path / "run"), str(tmp_path / "b.instdrive")]) == 2
    assert "instdrive apply" in capsys.readouterr().err
    assert not (tmp_path / "b.instdrive").exists()


def test_a_scene_that_changed_is_told_on_the_command_line(project, tmp_path, capsys):
    save_scene(tmp_path / "run", random_scene(seed=5))
    assert main(["info", str(project)]) == 2
    assert "has changed since it was edited" in capsys.readouterr().err
