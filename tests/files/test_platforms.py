"""Branches for Windows and macOS, run by pretending to be there."""

import errno
import math
import os
import sys
from pathlib import Path
from types import SimpleNamespace

import platformdirs.macos
import platformdirs.unix
import platformdirs.windows
import psutil
import pytest

from instdrive_core import available_memory
from instdrive_core.available_memory import measure_available_memory
from instdrive_core.errors import DataError
from instdrive_core.files import atomic, file_lock, temporaries, user_folders
from instdrive_core.files.file_lock import FileLock
from instdrive_core.files.user_folders import OVERRIDE, find_state_folder


@pytest.fixture
def home(tmp_path, monkeypatch):
    """A home of its own, and no variable that says where things are."""
    for name in (OVERRIDE, "XDG_STATE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setattr(Path, "home", lambda: tmp_path)
    return tmp_path


def pretend(monkeypatch, platform):
    classes = {
        "linux": platformdirs.unix.Unix,
        "darwin": platformdirs.macos.MacOS,
        "win32": platformdirs.windows.Windows,
    }
    monkeypatch.setattr(user_folders, "PlatformDirs", classes[platform])
    monkeypatch.setattr(sys, "platform", platform)


def place_of_version_0_1_0(platform, home, environment):
    """`state_folder` as it stood in version 0.1.0, whose recovery journals must still be found."""
    if platform == "win32":
        return Path(environment.get("LOCALAPPDATA") or home / "AppData" / "Local") / "InstDrive"
    if platform == "darwin":
        return home / "Library" / "Application Support" / "InstDrive"
    base = environment.get("XDG_STATE_HOME", "")
    return (Path(base) if base.startswith("/") else home / ".local" / "state") / "instdrive"


@pytest.mark.parametrize("environment", [{}, {"XDG_STATE_HOME": "/srv/state"}, {"XDG_STATE_HOME": "relative"}])
def test_the_state_folder_on_linux_is_where_it_was(home, monkeypatch, environment):
    pretend(monkeypatch, "linux")
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    assert find_state_folder() == place_of_version_0_1_0("linux", home, environment)


def test_the_state_folder_on_macos_is_where_it_was(home, monkeypatch):
    pretend(monkeypatch, "darwin")
    before = place_of_version_0_1_0("darwin", home, {})
    assert find_state_folder() == before
    monkeypatch.setenv("XDG_STATE_HOME", "/srv/state")
    assert find_state_folder() == Path("/srv/state/InstDrive")
    before.mkdir(parents=True)
    assert find_state_folder() == before, "journals of an older version lie there"


def test_the_state_folder_on_windows_is_where_it_was(home, monkeypatch):
    pretend(monkeypatch, "win32")
    local = home / "AppData" / "Local"
    monkeypatch.setattr(platformdirs.windows, "get_win_folder", lambda name: str(local))
    assert find_state_folder() == place_of_version_0_1_0("win32", home, {"LOCALAPPDATA": str(local)})


@pytest.mark.parametrize("platform", ["linux", "darwin", "win32"])
def test_the_variable_comes_first_everywhere(home, monkeypatch, platform):
    pretend(monkeypatch, platform)
    monkeypatch.setenv(OVERRIDE, str(home / "elsewhere"))
    assert find_state_folder() == home / "elsewhere"


class FakeMsvcrt:
    """Windows' locks of byte ranges, as `msvcrt.locking` offers them."""

    LK_NBLCK = 2

    def __init__(self):
        self.held = {}

    def locking(self, descriptor, mode, count):
        assert (mode, count) == (self.LK_NBLCK, 1)
        file = os.fstat(descriptor).st_ino
        if self.held.setdefault(file, descriptor) != descriptor:
            raise OSError(errno.EACCES, "Permission denied")


@pytest.fixture
def windows_locks(monkeypatch):
    locks = FakeMsvcrt()
    monkeypatch.setitem(sys.modules, "msvcrt", locks)
    monkeypatch.setattr(sys, "platform", "win32")
    return locks


def test_locks_on_windows(tmp_path, windows_locks):
    held = FileLock.acquire(tmp_path / "lock")
    assert held is not None
    assert FileLock.acquire(tmp_path / "lock") is None, "another holds it"
    assert FileLock.acquire(tmp_path / "other") is not None
    assert (tmp_path / "lock").stat().st_size == 0, "the locked byte lies beyond what others read and write"
    windows_locks.held.clear()
    held.release()
    again = FileLock.acquire(tmp_path / "lock")
    assert again is not None
    again.release()


def test_a_file_system_without_locks_counts_as_free(tmp_path, windows_locks, monkeypatch):
    def refuse(*_):
        raise OSError(errno.EINVAL, "Invalid argument")

    monkeypatch.setattr(windows_locks, "locking", refuse)
    file = os.open(tmp_path / "lock", os.O_CREAT | os.O_RDWR)
    assert file_lock.lock(file) is None
    os.close(file)


@pytest.fixture
def windows_files(monkeypatch, windows_locks):
    """Windows neither removes nor renames a file that is open anywhere."""
    monkeypatch.setattr(temporaries, "_POSIX", False)
    open_files, descriptors = set(), {}
    really = {name: getattr(os, name) for name in ("open", "close", "unlink", "replace")}

    def open_file(path, *args, **kwargs):
        descriptor = really["open"](path, *args, **kwargs)
        descriptors[descriptor] = str(path)
        open_files.add(str(path))
        return descriptor

    def close(descriptor):
        open_files.discard(descriptors.pop(descriptor, None))
        windows_locks.held.clear()
        really["close"](descriptor)

    def refuse_open(name):
        def change(path, *args, **kwargs):
            if not open_files.isdisjoint(map(str, (path, *args))):
                raise PermissionError(errno.EACCES, "it is used by another process", str(path))
            return really[name](path, *args, **kwargs)

        return change

    monkeypatch.setattr(os, "open", open_file)
    monkeypatch.setattr(os, "close", close)
    for name in ("unlink", "replace"):
        monkeypatch.setattr(os, name, refuse_open(name))
    return open_files


def test_files_are_written_whole_on_windows(tmp_path, windows_files):
    path = tmp_path / "a.bin"
    atomic.write_bytes(path, b"first")
    atomic.write_bytes(path, b"second")
    assert path.read_bytes() == b"second"
    with pytest.raises(TypeError), atomic.open_atomically(path) as file:
        file.write("third")  # text into a binary file
    assert path.read_bytes() == b"second"
    assert [file.name for file in tmp_path.iterdir()] == ["a.bin"]
    assert not windows_files


def test_writers_on_windows_take_different_temporary_files_and_remove_abandoned_ones(tmp_path, windows_files):
    (tmp_path / ".a.bin.0.tmp").write_bytes(b"left by a writer that was killed")
    path = tmp_path / "a.bin"
    with temporaries.create_temporary(path) as first, temporaries.create_temporary(path) as second:
        assert (first.path.name, second.path.name) == (".a.bin.0.tmp", ".a.bin.1.tmp")
        assert first.path.stat().st_size == 0
    assert list(tmp_path.iterdir()) == []


def test_a_target_that_another_program_has_open_is_told(tmp_path, windows_files):
    path = tmp_path / "a.bin"
    atomic.write_bytes(path, b"old")
    windows_files.add(str(path))
    with pytest.raises(DataError, match="it is used by another process"):
        atomic.write_bytes(path, b"new")
    assert path.read_bytes() == b"old"


def test_folders_are_not_synced_where_they_cannot_be(tmp_path, monkeypatch):
    synced = []
    monkeypatch.setattr(os, "fsync", synced.append)
    atomic.sync_folder(tmp_path)
    assert len(synced) == 1
    monkeypatch.setattr(os, "name", "nt")
    atomic.sync_folder(tmp_path)
    monkeypatch.undo()
    assert len(synced) == 1


@pytest.mark.parametrize("platform", ["linux", "darwin", "win32"])
def test_free_memory_is_measured_on_every_platform(monkeypatch, platform):
    monkeypatch.delenv(available_memory.VARIABLE, raising=False)
    monkeypatch.setattr(psutil, "virtual_memory", lambda: SimpleNamespace(available=3 << 30))
    monkeypatch.setattr(available_memory, "_CGROUP", Path("/there/is/none"))
    monkeypatch.setattr(sys, "platform", platform)
    if platform == "win32":
        monkeypatch.setitem(sys.modules, "resource", None)  # importing it fails, as it does there
    assert measure_available_memory() == 3 << 30


def test_limits_of_process_and_container_count(monkeypatch, tmp_path):
    monkeypatch.delenv(available_memory.VARIABLE, raising=False)
    monkeypatch.setattr(psutil, "virtual_memory", lambda: SimpleNamespace(available=math.inf))
    monkeypatch.setattr(available_memory, "_CGROUP", tmp_path)
    (tmp_path / "memory.max").write_text("max\n")
    (tmp_path / "memory.current").write_text("300\n")
    assert available_memory._measure_left_by_container() == math.inf
    (tmp_path / "memory.max").write_text("1000\n")
    assert measure_available_memory() == 700
    (tmp_path / "memory.current").write_text("1300\n")
    assert measure_available_memory() == 0


@pytest.mark.skipif(os.name != "posix", reason="Windows has no such limits")
def test_what_a_process_already_takes_counts_against_its_limit(monkeypatch, tmp_path):
    import resource

    monkeypatch.delenv(available_memory.VARIABLE, raising=False)
    monkeypatch.setattr(available_memory, "_CGROUP", tmp_path)
    monkeypatch.setattr(psutil, "virtual_memory", lambda: SimpleNamespace(available=math.inf))
    taken = psutil.Process().memory_info().vms
    monkeypatch.setattr(resource, "getrlimit", lambda kind: (2 * taken, 2 * taken))
    assert measure_available_memory() == pytest.approx(taken, rel=0.1)
