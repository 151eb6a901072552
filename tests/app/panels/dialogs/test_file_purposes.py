"""Which paths fit each purpose, and what the file browser lists."""

from dataclasses import replace

import pytest

from instdrive_app.files.file_names import find_folder_beside
from instdrive_app.files.folder_listing import list_folder
from instdrive_app.files.sample import find_sample_scene
from instdrive_app.panels.dialogs.file_browser import has_desktop_dialogs
from instdrive_app.panels.dialogs.file_purposes import PURPOSES, holds_scene
from instdrive_core.formats.folder.scenes import MANIFEST


def test_the_file_browser_lists_folders_and_scenes(tmp_path):
    for name in ("a.ply", "notes.txt", ".hidden.ply", "Z.PLY", "b.splat", "c.compressed.ply"):
        (tmp_path / name).write_bytes(b"")
    (tmp_path / "run").mkdir()
    found = list_folder(tmp_path, PURPOSES["open"].suffixes, holds_scene)
    assert [entry.path.name for entry in found] == ["run", "a.ply", "b.splat", "c.compressed.ply", "Z.PLY"]
    assert [entry.is_scene for entry in found] == [False, True, True, True, True]
    (tmp_path / "b.splat").write_bytes(b"x" * 4_200_000)
    sizes = {entry.path.name: entry.size_text for entry in list_folder(tmp_path, (".splat",), holds_scene)}
    assert sizes == {"run": "", "b.splat": "4.2 MB"}
    assert list_folder(tmp_path / "nowhere", (".ply",), holds_scene) == []


def test_paths_are_judged_before_they_are_used(tmp_path):
    (tmp_path / "a.ply").write_bytes(b"")
    (tmp_path / "run").mkdir()
    opened, exported, saved = (PURPOSES[name].find_problem for name in ("open", "export", "save"))
    assert not opened(tmp_path / "a.ply")
    assert opened(tmp_path / "run")
    (tmp_path / "run" / MANIFEST).write_text("{}")
    assert not opened(tmp_path / "run")
    for name in ("new.ply", "new.compressed.ply", "new.SPLAT", "new_run"):
        assert not exported(tmp_path / name)
    assert ".ply" in exported(tmp_path / "new.obj")
    assert "does not exist" in exported(tmp_path / "nowhere" / "new.ply")
    assert "file name" in exported(tmp_path)
    assert not saved(tmp_path / "new.instdrive")
    assert ".instdrive" in saved(tmp_path / "new.ply")
    assert ".instdrive" in saved(tmp_path / "new")


@pytest.mark.parametrize(("tools", "expected"), [((), False), (("zenity",), True), (("kdialog",), True)])
def test_desktop_dialogs_need_their_program(monkeypatch, tools, expected):
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setattr("shutil.which", lambda name: name if name in tools else None)
    assert has_desktop_dialogs() is expected


def test_a_projects_ending_need_not_be_typed(tmp_path):
    save = PURPOSES["save"]
    assert save.complete(tmp_path / "my street v1.2") == tmp_path / "my street v1.2.instdrive"
    assert save.complete(tmp_path / "a.instdrive") == tmp_path / "a.instdrive"
    assert save.complete(tmp_path / "a.ply") == tmp_path / "a.ply", "a scene's ending is a mistake to be told of"
    assert save.complete(tmp_path) == tmp_path
    assert PURPOSES["export"].complete(tmp_path / "folder") == tmp_path / "folder"


def test_new_files_go_beside_the_scene_but_never_into_the_program(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("XDG_CONFIG_HOME", raising=False)
    assert find_folder_beside(find_sample_scene()) == tmp_path
    (tmp_path / "Documents").mkdir()
    assert find_folder_beside(find_sample_scene()) == tmp_path / "Documents"
    (tmp_path / ".config").mkdir()
    (tmp_path / "Papers").mkdir()
    (tmp_path / ".config" / "user-dirs.dirs").write_text('XDG_DOCUMENTS_DIR="$HOME/Papers"\n', encoding="utf-8")
    assert find_folder_beside(find_sample_scene()) == tmp_path / "Papers"
    assert find_folder_beside(tmp_path / "drives" / "a.ply") == tmp_path / "drives"


def test_frames_of_a_film_go_into_a_new_or_empty_folder(tmp_path):
    films = replace(PURPOSES["export"], suffixes=(".mp4", ".webm", ".json"), fills=True)
    (tmp_path / "empty").mkdir()
    (tmp_path / "full" / "deep").mkdir(parents=True)
    for name in ("new", "empty", "a.mp4", "a.json"):
        assert films.find_problem(tmp_path / name) == "", name
    assert films.find_problem(tmp_path / "full") == "The folder is not empty; name a new one"
    assert "does not exist" in films.find_problem(tmp_path / "gone" / "film")
    assert films.find_problem(tmp_path / "a.avi").endswith("or have no ending for a folder of pictures")
