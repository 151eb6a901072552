"""Files are whole at any moment, also when the writer is killed."""

import os
import signal
import stat
import subprocess
import sys
import time

import pytest

from instdrive_core.errors import DataError
from instdrive_core.files.atomic import open_atomically, replace_atomically, write_bytes


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_the_file_appears_whole_and_nothing_else_stays(tmp_path):
    path = tmp_path / "new" / "a.bin"
    with open_atomically(path) as file:
        file.write(b"half")
        assert not path.exists()
        file.write(b" whole")
    assert path.read_bytes() == b"half whole"
    assert names(path.parent) == ["a.bin"]


def test_an_error_keeps_the_old_file(tmp_path):
    path = tmp_path / "a.bin"
    write_bytes(path, b"old")

    def fail_halfway():
        with open_atomically(path) as file:
            file.write(b"new")
            raise RuntimeError("disk full")

    with pytest.raises(RuntimeError, match="disk"):
        fail_halfway()
    assert path.read_bytes() == b"old"
    assert names(tmp_path) == ["a.bin"]


def test_what_the_system_refuses_is_explained(tmp_path):
    (tmp_path / "file").write_bytes(b"in the way")
    with pytest.raises(DataError, match="cannot be written"):
        write_bytes(tmp_path / "file" / "a.bin", b"new")
    (tmp_path / "folder" / "a.bin").mkdir(parents=True)
    with pytest.raises(DataError, match="cannot be written"):
        write_bytes(tmp_path / "folder" / "a.bin", b"new")
    assert names(tmp_path) == ["file", "folder"]
    assert names(tmp_path / "folder") == ["a.bin"]


def test_modes_are_those_of_ordinary_or_replaced_files(tmp_path):
    mask = os.umask(0o027)
    try:
        write_bytes(tmp_path / "a", b"1")
    finally:
        os.umask(mask)
    assert stat.S_IMODE((tmp_path / "a").stat().st_mode) == 0o640
    (tmp_path / "a").chmod(0o600)
    write_bytes(tmp_path / "a", b"2")
    assert stat.S_IMODE((tmp_path / "a").stat().st_mode) == 0o600


KEEP_WRITING = """
import itertools, sys
from instdrive_core.errors import DataError
from instdrive_core.files.atomic import replace_atomically, write_bytes
for number in itertools.count():
    write_bytes(sys.argv[1], bytes([number % 256]) * 3_000_000)
    print(number, flush=True)
"""


@pytest.mark.skipif(os.name != "posix", reason="needs SIGKILL")
def test_a_killed_writer_leaves_a_whole_file(tmp_path):
    path = tmp_path / "a.bin"
    for attempt in range(5):
        with subprocess.Popen([sys.executable, "-c", KEEP_WRITING, path], stdout=subprocess.PIPE) as writer:
            assert writer.stdout is not None
            assert writer.stdout.readline()
            time.sleep(0.003 * attempt)
            writer.send_signal(signal.SIGKILL)
        content = path.read_bytes()
        assert len(content) == 3_000_000
        assert content == content[:1] * 3_000_000


def test_a_library_that_makes_its_files_private_does_not_make_ours(tmp_path):
    plain, replaced = tmp_path / "plain", tmp_path / "replaced"
    plain.write_bytes(b"")
    with replace_atomically(replaced) as temporary:
        temporary.write_bytes(b"content")
        temporary.chmod(0o600)
    assert replaced.stat().st_mode == plain.stat().st_mode


@pytest.mark.skipif(os.name != "posix", reason="links need no rights on POSIX only")
@pytest.mark.parametrize("there", [True, False])
def test_what_a_link_leads_to_is_replaced_and_the_link_stays(tmp_path, there):
    real, link = tmp_path / "disk" / "a.bin", tmp_path / "link"
    real.parent.mkdir()
    if there:
        real.write_bytes(b"old")
    link.symlink_to("disk/a.bin")
    write_bytes(link, b"new")
    assert link.is_symlink()
    assert real.read_bytes() == b"new"
    assert names(tmp_path) == ["disk", "link"]
    assert names(real.parent) == ["a.bin"]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes")
def test_a_pipe_is_not_replaced(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(DataError, match="pipe"):
        write_bytes(tmp_path / "pipe", b"new")
    assert names(tmp_path) == ["pipe"]
    assert stat.S_ISFIFO((tmp_path / "pipe").stat().st_mode)
