"""Folders that are whole or absent, however their writer ends."""

import pytest

from instdrive_core.errors import DataError
from instdrive_core.files.new_folder import fill_new_folder


def test_a_folder_appears_when_it_is_whole(tmp_path):
    with fill_new_folder(tmp_path / "deep" / "film") as part:
        (part / "a.png").write_bytes(b"a")
        assert not (tmp_path / "deep" / "film").exists()
    assert [path.name for path in (tmp_path / "deep").iterdir()] == ["film"]
    assert [path.name for path in (tmp_path / "deep" / "film").iterdir()] == ["a.png"]


def test_nothing_is_left_of_one_that_fails(tmp_path):
    (tmp_path / "film").mkdir()

    def fail():
        with fill_new_folder(tmp_path / "film") as part:
            (part / "a.png").write_bytes(b"a")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    assert [path.name for path in tmp_path.iterdir()] == ["film"]
    assert not any((tmp_path / "film").iterdir())


def test_what_a_killed_writer_left_is_not_taken_over(tmp_path):
    left = tmp_path / ".film.part"
    (left / "folder").mkdir(parents=True)
    (left / "frame_00099.png").touch()
    with fill_new_folder(tmp_path / "film") as part:
        (part / "frame_00001.png").touch()
    assert [path.name for path in (tmp_path / "film").iterdir()] == ["frame_00001.png"]


def test_two_writers_and_full_folders_are_refused(tmp_path):
    with fill_new_folder(tmp_path / "film") as part:
        (part / "a.png").touch()
        with pytest.raises(DataError, match="another program"), fill_new_folder(tmp_path / "film"):
            pass
    with pytest.raises(DataError, match="not an empty folder"), fill_new_folder(tmp_path / "film"):
        pass
    (tmp_path / "file").touch()
    with pytest.raises(DataError, match="cannot be written"), fill_new_folder(tmp_path / "file" / "film"):
        pass
    assert (tmp_path / "film" / "a.png").exists()
