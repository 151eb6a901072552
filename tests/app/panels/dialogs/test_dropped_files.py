"""What is made of the paths that were dropped onto the window, and how their names are told."""

from pathlib import Path

import pytest
from procedural_street import procedural_street

from instdrive_app.files.file_names import (
    find_name_problem,
    find_working_folder,
    format_path,
    is_displayable,
    join_names,
)
from instdrive_app.files.folder_listing import list_folder
from instdrive_app.panels.dialogs.dropped_files import sort_dropped
from instdrive_app.panels.dialogs.file_purposes import PURPOSES, SCENE_ENDINGS, holds_scene
from instdrive_core.formats.registry import save_scene


@pytest.fixture
def folder(tmp_path):
    """Files whose names alone say what they are, and a scene folder."""
    for name in ("a.ply", "b.SPZ", "drive.instdrive", "notes.txt", "photo.jpg"):
        (tmp_path / name).touch()
    (tmp_path / "empty").mkdir()
    save_scene(tmp_path / "street", procedural_street())
    return tmp_path


def test_scenes_projects_and_the_rest_keep_their_order(folder):
    names = ["drive.instdrive", "photo.jpg", "street", "b.SPZ", "a.ply", "a.ply"]
    found = sort_dropped([folder / name for name in names])
    assert [path.name for path in found.scenes] == ["street", "b.SPZ", "a.ply"], "and nothing twice"
    assert [path.name for path in found.projects] == ["drive.instdrive"]
    assert [path.name for path in found.openable] == ["drive.instdrive", "street", "b.SPZ", "a.ply"]
    assert found.complaint == "photo.jpg is not a scene or project that can be opened"


def test_each_problem_has_its_own_words(folder):
    problems = sort_dropped(
        [folder / "empty", folder / "gone.ply", folder / "gone" / ("n" * 300), Path("https://a.org/s.ply")]
    ).problems
    assert problems[0].startswith("The folder empty contains no scene")
    assert problems[1].startswith(f"{folder / 'gone.ply'} was not found")
    assert "was not found" in problems[2]
    assert problems[3].startswith("https://a.org/s.ply is not on this computer")


def test_of_many_problems_the_number_is_told(folder):
    complaint = sort_dropped([folder / f"{number}.ply" for number in range(7)]).complaint
    assert "2.ply was not found" in complaint
    assert "3.ply" not in complaint
    assert "4 others" in complaint
    assert sort_dropped([]).complaint == ""


def test_names_that_are_no_text_are_told_and_not_listed(folder):
    odd = folder / "caf\udce9.ply"
    odd.touch()
    assert not is_displayable(odd)
    assert is_displayable(folder / "café.ply")
    assert format_path(odd.name) == "caf\ufffd.ply"
    assert find_name_problem(folder / "café.ply") == ""
    assert sort_dropped([odd]).openable == ()
    assert odd.name not in [entry.path.name for entry in list_folder(folder, SCENE_ENDINGS, holds_scene)]


def test_paths_that_cannot_be_looked_at_are_no_answer(folder):
    for purpose in PURPOSES.values():
        assert purpose.find_problem(folder / ("n" * 300) / "a.ply")
    assert not holds_scene(folder / ("n" * 300))


def test_enumerations():
    paths = [Path(f"/x/{letter}.ply") for letter in "abcdef"]
    assert join_names(paths[:1]) == "a.ply"
    assert join_names(paths[:2]) == "a.ply and b.ply"
    assert join_names(paths[:4]) == "a.ply, b.ply, c.ply and d.ply"
    assert join_names(paths) == "a.ply, b.ply, c.ply and 3 others"


def test_a_working_folder_that_is_gone_or_no_text_is_not_shown(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert find_working_folder() == tmp_path
    for name in ("d\udce9r", "gone"):
        (tmp_path / name).mkdir()
        monkeypatch.chdir(tmp_path / name)
        if name == "gone":
            (tmp_path / name).rmdir()
        assert find_working_folder() == Path.home()
