"""What tests of projects share: a scene with edits of several kinds, and archives with a member rewritten."""

import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from document_snapshot import snapshot
from random_scene import random_scene

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.color import RecolorInstances
from instdrive_core.edits.kinds.delete import DeleteInstances, DeleteSelected
from instdrive_core.edits.kinds.insert import InsertScene
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.kinds.select import SelectInstances
from instdrive_core.edits.kinds.select_rows import SelectRows
from instdrive_core.formats.registry import save_scene
from instdrive_core.project.open import open_document

VIEW = {"camera": [1.0, 2.5, -3.0], "time": 0.2, "mode": "instance", "names": {"a": None}}


def saved_scene(folder: Path, name: str = "street", **parameters) -> Path:
    """A scene folder with everything in it."""
    path = folder / name
    save_scene(path, random_scene(**parameters))
    return path


def edited_document(folder: Path) -> Document:
    """A document with ten edits, of which eight are done; one inserts the scene ``folder/car``."""
    document, _ = open_document(saved_scene(folder, count=6000))
    inserted = saved_scene(folder, "car", seed=1, count=15, instances=2, actors=1)
    rows = np.flatnonzero(np.random.default_rng(0).random(6000) < 0.5)
    for edit in (
        SelectInstances((2,)),
        DeleteSelected(),
        InsertScene(str(inserted), (1.0, 0.0, 0.0)),
        MoveInstances((4, 7), (0.1, 0.2, 0.3), (0.9, 0.1, 0.0, 0.3), 1.1),
        RecolorInstances((1, 3), "tint", (0.1, 0.7, 0.3)),
        SelectRows(rows),
        DeleteSelected(),
        RecolorInstances((5,), "solid", (1.0, 0.0, 0.0)),
        DeleteInstances((1,)),
        SelectInstances((3,)),
    ):
        document.apply(edit)
    document.undo()
    document.undo()
    return document


def assert_same_document(left: Document, right: Document) -> None:
    """Equal bits now, after undoing everything, and after redoing everything."""
    assert [edit.to_json() for edit in left.history.edits] == [edit.to_json() for edit in right.history.edits]
    cursor = left.history.cursor
    assert right.history.cursor == cursor
    assert snapshot(left) == snapshot(right)
    for document in (left, right):
        while document.undo():
            pass
    assert snapshot(left) == snapshot(right)
    for document in (left, right):
        while document.redo():
            pass
    assert snapshot(left) == snapshot(right)
    for document in (left, right):
        while document.history.cursor > cursor:
            document.undo()


def rewrite_member(path: Path, name: str, change: Callable[[bytes], bytes]) -> None:
    """Replace a member of an archive by what `change` makes of its content."""
    with zipfile.ZipFile(path) as archive:
        members = {member: archive.read(member) for member in archive.namelist()}
    members[name] = change(members[name])
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for member, content in members.items():
            archive.writestr(member, content)


def rewrite_json(path: Path, name: str, change: Callable[[dict[str, Any]], object]) -> None:
    """Let `change` edit a JSON object in an archive."""

    def changed(content: bytes) -> bytes:
        value = json.loads(content)
        change(value)
        return json.dumps(value).encode()

    rewrite_member(path, name, changed)
