import pytest
from random_scene import assert_same_scene, random_scene

from instdrive_core.edits.queries.bake import freeze_at_time
from instdrive_core.errors import DataError
from instdrive_core.formats.registry import open_scene, save_scene


def test_files_and_folders_are_told_apart(tmp_path):
    scene = random_scene()
    save_scene(tmp_path / "run", scene)
    assert_same_scene(open_scene(tmp_path / "run"), scene)
    assert_same_scene(open_scene(tmp_path / "run" / "scene.json"), scene)
    save_scene(tmp_path / "A.PLY", freeze_at_time(scene, 0.0))
    assert len(open_scene(str(tmp_path / "A.PLY"))) == len(freeze_at_time(scene, 0.0))
    (tmp_path / "run.v2").mkdir()
    save_scene(tmp_path / "run.v2", scene)
    assert_same_scene(open_scene(tmp_path / "run.v2"), scene)


@pytest.mark.parametrize(
    ("name", "message"),
    [("absent.ply", "no such file"), ("empty", "holds no scene.json"), ("notes.txt", "Known are .ply")],
)
def test_what_cannot_be_opened_is_explained(tmp_path, name, message):
    (tmp_path / "empty").mkdir()
    (tmp_path / "notes.txt").write_text("hello")
    with pytest.raises(DataError, match=message):
        open_scene(tmp_path / name)


def test_unknown_endings_are_not_written(tmp_path):
    with pytest.raises(DataError, match=r"'\.obj'"):
        save_scene(tmp_path / "scene.obj", random_scene())
    assert list(tmp_path.iterdir()) == []


def test_a_name_that_is_only_an_ending_is_a_file(tmp_path):
    save_scene(tmp_path / ".ply", random_scene(count=5, actors=0))
    assert (tmp_path / ".ply").is_file()
    assert len(open_scene(tmp_path / ".ply")) == 5
