"""What paths are asked for, and what is done with the answer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from instdrive_app.session import EditorSession
from instdrive_core.formats.registry import FORMATS
from instdrive_core.formats.scene_folder import MANIFEST
from instdrive_core.formats.sog_levels import is_sog_folder
from instdrive_core.project.save import SUFFIX

SCENES = tuple(fmt.suffix for fmt in FORMATS if fmt.suffix)
WRITTEN = tuple(fmt.suffix for fmt in FORMATS if fmt.suffix and fmt.write is not None)


@dataclass(frozen=True)
class FilePurpose:
    """One reason to ask for a path. A new one is an entry of `PURPOSES`."""

    title: str
    verb: str
    """On the button."""
    suffixes: tuple[str, ...]
    """Endings, lower case, that are listed and taken."""
    act: Callable[[EditorSession, Path], None]
    writes: bool = False
    folders: bool = True
    """Whether the answer can be a folder: one that holds a scene, or a new one."""
    suggestion: str = ""
    """Ending of the name that is proposed for a new file, after the scene's own."""

    def problem(self, path: Path) -> str:
        """Why the path cannot be the answer; empty where it can."""
        return self._problem_of_new(path) if self.writes else self._problem_of_old(path)

    def _problem_of_old(self, path: Path) -> str:
        if path.is_file() and path.name.lower().endswith(self.suffixes):
            return ""
        if self.folders and path.is_dir() and holds_scene(path):
            return ""
        return "Choose a scene file or a folder that holds a scene"

    def _problem_of_new(self, path: Path) -> str:
        endings = " or ".join(self.suffixes)
        if path.is_dir() and not (self.folders and holds_scene(path)):
            return f"Add a file name that ends in {endings}"
        if not path.name.lower().endswith(self.suffixes) and (path.suffix or not self.folders):
            folder = ", or be that of a scene folder" if self.folders else ""
            return f"The name must end in {endings}{folder}"
        return "" if path.parent.is_dir() else f"There is no folder {path.parent}"


def holds_scene(folder: Path) -> bool:
    """Whether a folder can be opened as a scene."""
    return (folder / MANIFEST).is_file() or is_sog_folder(folder)


def _open(session: EditorSession, path: Path) -> None:
    session.leave(lambda: session.files.open(path))


def _save(session: EditorSession, path: Path) -> None:
    then, session.waiting = session.waiting, None
    session.save(path, then or (lambda: None))


def _export(session: EditorSession, path: Path) -> None:
    session.export(path)


PURPOSES = {
    "open": FilePurpose("Open a scene or project", "Open", (SUFFIX, *SCENES), _open),
    "insert": FilePurpose("Insert a scene", "Insert", SCENES, lambda session, path: session.inserting.insert(path)),
    "save": FilePurpose("Save the project", "Save", (SUFFIX,), _save, True, False, SUFFIX),
    "export": FilePurpose("Export the edited scene", "Export", WRITTEN, _export, True, True, "_edited.ply"),
}
"""By the name that `session.dialog` takes."""
