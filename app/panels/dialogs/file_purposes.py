"""What paths are asked for, and what is done with the answer."""

from __future__ import annotations

import os.path  # its questions say no to what cannot be looked at, such as names that are too long: Path's raise
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from instdrive_app.session.editor_session import EditorSession
from instdrive_app.session.export_kinds import WRITTEN
from instdrive_core.formats.folder.scenes import MANIFEST
from instdrive_core.formats.registry import FORMATS
from instdrive_core.formats.sog.levels import is_sog_folder
from instdrive_core.project.save import SUFFIX

SCENE_ENDINGS = tuple(fmt.suffix for fmt in FORMATS if fmt.suffix)
FILE_ENDINGS = (*SCENE_ENDINGS, SUFFIX, ".json", ".glb", ".png")
"""Endings that no folder's name should have."""


@dataclass(frozen=True)
class FilePurpose:
    """One reason to ask for a path. A new one is an entry of `PURPOSES`."""

    title: str
    verb: str
    """On the button."""
    suffixes: tuple[str, ...]
    """Endings, lower case, that are listed and taken; none where a folder is filled with files."""
    act: Callable[[EditorSession, Path], None]
    writes: bool = False
    folders: bool = True
    """Whether the answer can be a folder: one that holds a scene, or a new one."""
    suggestion: str = ""
    """Ending of the name that is proposed for a new file, after the scene's own."""
    refusal: str = ""
    """Why no path can be the answer; empty where some can."""
    on_close: Callable[[EditorSession], None] = lambda _: None
    """Called when the dialog is gone, after `act` where there was an answer."""

    def find_problem(self, path: Path) -> str:
        """Why the path cannot be the answer; empty where it can."""
        if self.refusal or not self.writes:
            return self.refusal or self._check_existing(path)
        return self._check_new(path) if self.suffixes else _check_filled_folder(path)

    def _check_existing(self, path: Path) -> str:
        if os.path.isfile(path) and path.name.lower().endswith(self.suffixes):
            return ""
        if self.folders and holds_scene(path):
            return ""
        return "Choose a scene file or a folder that holds a scene"

    def _check_new(self, path: Path) -> str:
        endings = " or ".join(self.suffixes)
        if os.path.isdir(path) and not (self.folders and holds_scene(path)):
            return f"Add a file name that ends in {endings}"
        if not path.name.lower().endswith(self.suffixes) and (path.suffix or not self.folders):
            folder = ", or be that of a scene folder" if self.folders else ""
            return f"The name must end in {endings}{folder}"
        return _check_parent(path)


def _check_filled_folder(path: Path) -> str:
    """Of a folder that many files are written into."""
    if os.path.isfile(path) or path.name.lower().endswith(FILE_ENDINGS):
        return "Many files are written: give the name of a folder"
    if holds_scene(path):
        return "That folder holds a scene; give the name of another"
    return _check_parent(path)


def _check_parent(path: Path) -> str:
    return "" if os.path.isdir(path.parent) else f"There is no folder {path.parent}"


def holds_scene(folder: Path) -> bool:
    """Whether this is a folder that can be opened as a scene; one that cannot be looked into is not."""
    try:
        return folder.is_dir() and ((folder / MANIFEST).is_file() or is_sog_folder(folder))
    except OSError:
        return False


def _open(session: EditorSession, path: Path) -> None:
    session.leave(lambda: session.files.open(path))


def _save(session: EditorSession, path: Path) -> None:
    then, session.waiting = session.waiting, None
    session.save(path, then or (lambda: None))


def _stay(session: EditorSession) -> None:
    """Who gives no name wants to stay: a later save must not end the editor."""
    session.waiting = None


PURPOSES = {
    "open": FilePurpose("Open a scene or project", "Open", (SUFFIX, *SCENE_ENDINGS), _open),
    "insert": FilePurpose(
        "Insert a scene", "Insert", SCENE_ENDINGS, lambda session, path: session.inserting.insert(path)
    ),
    "save": FilePurpose("Save the project", "Save", (SUFFIX,), _save, True, False, SUFFIX, on_close=_stay),
    "export": FilePurpose("Export", "Export", WRITTEN, lambda session, path: session.exporting.export(path), True),
}
"""By the name that `session.dialog` takes."""
