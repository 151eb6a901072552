"""What `no_loss` kills: processes that save, export or edit without end, and how to tell what they have left.

Generation n of a file can be told from every part of it. After each one a process tells its number and when.
"""

from __future__ import annotations

import itertools
import struct
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from benchmarks.edit_street import build_edit_street
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.rename import RenameInstance
from instdrive_core.edits.kinds.select_rows import SelectRows
from instdrive_core.formats.registry import open_scene, save_scene
from instdrive_core.project.open import open_document
from instdrive_core.project.recoverable import find_pending_sessions, restore_session
from instdrive_core.project.recovery import Recovery
from instdrive_core.project.save import save_project
from instdrive_core.scene.scene import Scene

ACKNOWLEDGED = struct.Struct("<qd")
"""Generation, and `time.monotonic` when it was done."""
_PAUSE = 0.001
"""Seconds between edits: faster than any hand."""


class TornError(Exception):
    """A file is no generation of anything."""


class Target(ABC):
    """Something that is written again and again into a folder."""

    @abstractmethod
    def generations(self, folder: Path) -> Iterator[int]:
        """Write one generation after another; yields each when it is whole."""

    @abstractmethod
    def found(self, folder: Path) -> int:
        """The generation that is there. Raises TornError, or what the readers raise."""

    def write_once(self, folder: Path) -> None:
        """What the next user of the folder would do: write the same name again."""
        next(self.generations(folder))


class ProjectSaves(Target):
    """A project that gains a new name and a selection of scattered splats with each save."""

    name = "a.instdrive"

    def generations(self, folder: Path) -> Iterator[int]:
        document = _street_document(folder)
        for number in itertools.count():
            _edit(document, number)
            save_project(folder / self.name, document, {"generation": number})
            yield number

    def found(self, folder: Path) -> int:
        document, view = open_document(folder / self.name)
        number = view["generation"] if view else -1
        if _list_edits(document) != number:
            raise TornError(f"generation {number} holds {_list_edits(document)} edits")
        return number


class Exports(Target):
    """A scene whose every number tells the generation, as one file or as a folder."""

    def __init__(self, name: str) -> None:
        self.name = name

    def generations(self, folder: Path) -> Iterator[int]:
        for number in itertools.count():
            save_scene(folder / self.name, _build_numbered_scene(number))
            yield number

    def found(self, folder: Path) -> int:
        scene = open_scene(folder / self.name)
        number = int(scene.gaussians.means[0, 0])
        expected = _build_numbered_scene(number).gaussians
        same = [np.array_equal(array, getattr(expected, name)) for name, array in scene.gaussians.arrays().items()]
        if not all(same):
            raise TornError(f"generation {number} holds other numbers, too")
        return number


class Autosave(Target):
    """A journal of edits that are made as fast as it takes them."""

    def generations(self, folder: Path) -> Iterator[int]:
        document = _street_document(folder)
        recovery = Recovery.begin(document, folder / "street", root=folder / "recovery")
        for number in itertools.count():
            _edit(document, number)
            recovery.record()
            yield number
            time.sleep(_PAUSE)

    def found(self, folder: Path) -> int:
        sessions = find_pending_sessions(folder / "recovery")
        if not sessions:
            return -1
        restored = restore_session(sessions[0])
        try:
            return _list_edits(restored.document)
        finally:
            restored.remove()

    def write_once(self, folder: Path) -> None:
        """Sessions have folders of their own: nothing is written twice."""


TARGETS: dict[str, tuple[Target, ...]] = {
    "project": (ProjectSaves(),),
    "autosave": (Autosave(),),
    "export": (Exports("a.ply"), Exports("a")),
}
"""By what the issue calls them."""


def prepare(folder: Path) -> None:
    """What the targets start from."""
    save_scene(folder / "street", build_edit_street())


def run_until_killed(target: Target, folder: Path, connection: Connection) -> None:
    """Tell each generation through the pipe."""
    for number in target.generations(folder):
        connection.send_bytes(ACKNOWLEDGED.pack(number, time.monotonic()))


def _street_document(folder: Path) -> Document:
    document, _ = open_document(folder / "street")
    return document


def _edit(document: Document, number: int) -> None:
    """Two edits; every tenth time the second one selects thousands of scattered splats."""
    document.apply(RenameInstance(1, f"name {number}"))
    step = 2 if number % 10 == 0 else 400
    document.apply(SelectRows(np.arange(number % 7, len(document.scene), step)))


def _list_edits(document: Document) -> int:
    """The last generation whose edits are there, all earlier ones before them. Raises TornError."""
    edits = document.history.done
    names = [edit.name for edit in edits[::2] if isinstance(edit, RenameInstance)]
    if names != [f"name {number}" for number in range((len(edits) + 1) // 2)]:
        raise TornError(f"{len(edits)} edits are not those that were made")
    return len(edits) // 2 - 1


def _build_numbered_scene(number: int) -> Scene:
    scene = build_edit_street(ground=8000, cars=20)
    for array in scene.gaussians.arrays().values():
        array += np.float32(number)
    scene.gaussians.means[0, 0] = number
    scene.actors, scene.nodes = (), np.zeros_like(scene.nodes)
    return scene
