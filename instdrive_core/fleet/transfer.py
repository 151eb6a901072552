"""Copies between addresses and this machine: clips are fetched, runs fetched and sent as they grow."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from instdrive_core.errors import DataError
from instdrive_core.files.atomic import replace_atomically
from instdrive_core.fleet.place import open_file_system
from instdrive_core.jobs.job_file import LOCK, STATE, WISH

SEND_SECONDS = 20.0
"""Least time between two sendings of a run that grows."""
_STAYS = (LOCK, WISH)
_FETCHED = ".fetched"


def fetch_source(address: str, folder: Path, on_note: Callable[[str], None] = lambda note: None) -> Path:
    """Fetch a clip into a folder and return its place there. Files that are there in their size are not fetched again.

    Raises DataError where the address holds nothing or cannot be reached.
    """
    target, marker = folder / address.rstrip("/").split("/")[-1], folder / _FETCHED
    if marker.is_file():
        return target
    folder.mkdir(parents=True, exist_ok=True)
    system, root = open_file_system(address)
    try:
        sizes = _list_sizes(system, root)
        for number, (path, size) in enumerate(sorted(sizes.items())):
            file = target / path if path else target
            if not file.is_file() or (size is not None and file.stat().st_size != size):
                _fetch(system, f"{root}/{path}" if path else root, file)
            on_note(f"fetching {address}: {number + 1} of {len(sizes)} files")
    except DataError:
        raise
    except Exception as error:
        problem = f"cannot be fetched ({type(error).__name__}: {error})"
        raise DataError(address, problem, "Check address, network and permission") from error
    if not sizes:
        raise DataError(address, "was not found, or holds no files", "Give the address of a clip's folder or a video")
    marker.touch()
    return target


@dataclass
class RunMirror:
    """A run on this machine and its copy at an address, which is what counts when another machine goes on."""

    address: str
    run: Path
    _sent: dict[str, tuple[int, int]] = field(default_factory=dict)
    """Size and time of each file when it was sent."""
    _last: float = float("-inf")

    def fetch(self) -> None:
        """Fetch the run as it was sent last. What an attempt that died here did not send is replaced."""
        system, root = open_file_system(self.address)
        for path in _list_sizes(system, root):
            if path:
                _fetch(system, f"{root}/{path}", self.run / path)
                self._note(path)

    def send(self, *, now: bool = False) -> bool:
        """Send what changed where that is due, or `now`; returns whether it did. The state is sent last."""
        if not now and time.monotonic() - self._last < SEND_SECONDS:
            return False
        system, root = open_file_system(self.address)
        paths = (file.relative_to(self.run).as_posix() for file in self.run.rglob("*") if file.is_file())
        for path in sorted(paths, key=lambda path: (path.endswith(STATE), path)):
            file = self.run / path
            try:
                if file.name in _STAYS or file.name.startswith(".") or self._sent.get(path) == _look(file):
                    continue
                content = file.read_bytes()
            except FileNotFoundError:  # replaced meanwhile by the run itself
                continue
            self._note(path)
            try:
                system.makedirs(f"{root}/{path}".rsplit("/", 1)[0], exist_ok=True)
                system.pipe_file(f"{root}/{path}", content)
            except Exception as error:
                self._sent.pop(path, None)
                problem = f"cannot be sent ({type(error).__name__}: {error})"
                raise DataError(f"{self.address}/{path}", problem, "Check address, network and permission") from error
        self._last = time.monotonic()
        return True

    def _note(self, path: str) -> None:
        self._sent[path] = _look(self.run / path)


def _look(file: Path) -> tuple[int, int]:
    found = file.stat()
    return found.st_size, found.st_mtime_ns


def _list_sizes(system: Any, root: str) -> dict[str, int | None]:
    """Sizes of all files below a path, by their relative paths; of a file, its own under the empty path."""
    if system.isfile(root) and not system.isdir(root):
        return {"": system.info(root).get("size")}
    if not system.exists(root):
        return {}
    found = system.find(root, detail=True)
    sizes = {str(path)[len(root) :].strip("/"): facts.get("size") for path, facts in found.items()}
    for path in sizes:
        if path.startswith("/") or ".." in path.split("/") or "\\" in path:
            raise DataError(root, f"holds a file with the path {path!r}", "Rename it")
    return sizes


def _fetch(system: Any, source: str, file: Path) -> None:
    with replace_atomically(file) as temporary:
        system.get_file(source, str(temporary))
