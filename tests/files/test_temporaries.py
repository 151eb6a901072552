"""What a killed writer leaves is removed by the next of the same name, what a living one writes is not."""

import os
import signal
import subprocess
import sys
import threading

import pytest

from instdrive_core.errors import DataError
from instdrive_core.files.atomic import open_atomically, replace_atomically, write_bytes
from instdrive_core.files.file_lock import FileLock
from instdrive_core.files.temporaries import create_temporary
from instdrive_core.formats.folder.scenes import read_scene_folder, write_scene_folder

HANG = """
import sys, time
from pathlib import Path
from instdrive_core.files.temporaries import create_temporary
with create_temporary(Path(sys.argv[1])) as temporary:
    temporary.path.write_bytes(b"half")
    print(temporary.path.name, flush=True)
    time.sleep(3600)
"""


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def hanging_writer(path):
    """A process that is in the middle of writing `path`, and what it writes to."""
    writer = subprocess.Popen([sys.executable, "-c", HANG, path], stdout=subprocess.PIPE, text=True)
    assert writer.stdout is not None
    return writer, path.with_name(writer.stdout.readline().strip())


@pytest.mark.skipif(os.name != "posix", reason="needs SIGKILL")
def test_abandoned_files_go_and_those_in_use_stay(tmp_path):
    path = tmp_path / "a.bin"
    writers = [hanging_writer(path) for _ in range(3)]
    try:
        assert names(tmp_path) == [".a.bin.0.tmp", ".a.bin.1.tmp", ".a.bin.2.tmp"]
        for writer, _ in writers[1:]:
            writer.send_signal(signal.SIGKILL)
            writer.wait()
        write_bytes(path, b"whole")
        assert names(tmp_path) == [".a.bin.0.tmp", "a.bin"]
        assert writers[0][1].read_bytes() == b"half"
    finally:
        for writer, _ in writers:
            writer.kill()
            writer.communicate()
    write_bytes(path, b"again")
    assert names(tmp_path) == ["a.bin"]


def test_writers_of_one_name_do_not_meet(tmp_path):
    path, wrong = tmp_path / "a.bin", []

    def write(letter):
        for _ in range(30):
            with open_atomically(path) as file:
                for _ in range(20):
                    file.write(letter * 1000)
            content = path.read_bytes()
            wrong.extend([content] if len(content) != 20_000 or content.strip(content[:1]) else [])

    threads = [threading.Thread(target=write, args=(bytes([65 + k]),)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong
    assert names(tmp_path) == ["a.bin"]


def test_a_link_in_the_way_is_neither_followed_nor_removed(tmp_path):
    (tmp_path / "precious").write_bytes(b"precious")
    (tmp_path / ".a.bin.0.tmp").symlink_to(tmp_path / "precious")
    write_bytes(tmp_path / "a.bin", b"new")
    assert (tmp_path / "precious").read_bytes() == b"precious"
    assert (tmp_path / "a.bin").read_bytes() == b"new"


def test_a_name_given_away_is_not_removed_from_its_next_user(tmp_path):
    path = tmp_path / "a.bin"
    with create_temporary(path) as first:
        first.path.write_bytes(b"first")
        first.replace(path)
        with create_temporary(path) as second:
            assert second.path == first.path
            first.close()
            assert second.path.exists()


def test_temporaries_of_changing_names_are_known_by_one(tmp_path):
    def fail():
        with replace_atomically(tmp_path / "scene.123.bin", temporary_for="scene.bin") as temporary:
            assert temporary.name == ".scene.bin.0.tmp"
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert names(tmp_path) == []


def test_a_scene_folder_clears_what_its_killed_writers_left(tmp_path):
    from random_scene import random_scene

    (tmp_path / ".scene.safetensors.0.tmp").write_bytes(b"half")
    (tmp_path / ".scene.json.0.tmp").write_bytes(b"half")
    (tmp_path / "scene.0123456789abcdef.safetensors").write_bytes(b"never named")
    write_scene_folder(tmp_path, random_scene())
    assert len(names(tmp_path)) == 2


def test_a_lock_is_held_once_and_freed_by_release(tmp_path):
    held = FileLock.acquire(tmp_path / "lock")
    assert held is not None
    assert FileLock.acquire(tmp_path / "lock") is None
    held.release()
    held.release()
    again = FileLock.acquire(tmp_path / "lock")
    assert again is not None
    again.release()


def test_a_scene_folder_whose_manifest_does_not_fit_the_disk_keeps_the_old_scene_only(tmp_path, monkeypatch):
    from random_scene import assert_same_scene, random_scene

    write_scene_folder(tmp_path, random_scene())
    before = names(tmp_path)

    def full(path, content):
        raise DataError(path, "the file cannot be written (No space left on device)", "Free some space")

    monkeypatch.setattr("instdrive_core.formats.folder.scenes.write_bytes", full)
    with pytest.raises(DataError, match="No space"):
        write_scene_folder(tmp_path, random_scene(seed=1))
    assert names(tmp_path) == before
    assert_same_scene(read_scene_folder(tmp_path), random_scene())
