"""The purposes for which the editor asks for a path: which paths fit, and what is done with the answer."""

from __future__ import annotations

import os.path  # its questions say no to what cannot be looked at, such as names that are too long: Path's raise
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from instdrive_app.files.file_names import list_choices
from instdrive_app.messages import read_error
from instdrive_app.preferences.key_presets import read_keys, write_keys
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.session.export_kinds import WRITTEN
from instdrive_core.errors import DataError, OptionError
from instdrive_core.formats.registry import FORMATS, is_scene_folder
from instdrive_core.project.save import SUFFIX
from instdrive_core.wording import phrase

SCENE_ENDINGS = tuple(fmt.suffix for fmt in FORMATS if fmt.suffix)
FILE_ENDINGS = (*SCENE_ENDINGS, SUFFIX, ".json", ".glb", ".png", ".mp4", ".webm")
"""File endings that a folder's name must not have."""


@dataclass(frozen=True)
class FilePurpose:
    """One reason to ask for a path. A new one is an entry of `PURPOSES`."""

    title: str
    verb: str
    """Label of the button that accepts the path."""
    suffixes: tuple[str, ...]
    """Lower-case endings that are listed and accepted; empty if the answer is a folder to fill with files."""
    act: Callable[[EditorSession, Path, Callable[[], None]], None]
    """Does what the path was asked for; the last argument is what follows a save."""
    writes: bool = False
    folders: bool = True
    """Whether the answer can be a scene folder, or a new folder."""
    suggestion: str = ""
    """Ending of the proposed name for a new file, after the scene's own name."""
    refusal: str = ""
    """Why no path at all can be accepted; empty if some can."""
    fills: bool = False
    """Whether a folder is filled with files; else it is that of a scene."""

    def complete(self, path: Path) -> Path:
        """Add the ending that the user need not type: that of a file whose name can have no other."""
        if not self.writes or self.folders or len(self.suffixes) != 1 or os.path.isdir(path) or not path.name:
            return path
        has_ending = path.name.lower().endswith((*self.suffixes, *FILE_ENDINGS))
        return path if has_ending else path.with_name(path.name + self.suffixes[0])

    def find_problem(self, path: Path) -> str:
        """Say why the path cannot be accepted; empty if it can."""
        if self.refusal or not self.writes:
            return self.refusal or self._check_existing(path)
        return self._check_new(path) if self.suffixes else _check_filled_folder(path)

    def _check_existing(self, path: Path) -> str:
        if os.path.isfile(path) and path.name.lower().endswith(self.suffixes):
            return ""
        if self.folders and holds_scene(path):
            return ""
        if not self.folders:
            return phrase("Choose a file whose name ends in {endings}", endings=list_choices(self.suffixes))
        return "Choose a scene file or a folder that contains a scene"

    def _check_new(self, path: Path) -> str:
        endings = list_choices(self.suffixes)
        if self.fills and not path.suffix:
            return "The folder is not empty; name a new one" if _holds_anything(path) else _check_parent(path)
        if os.path.isdir(path) and not (self.folders and holds_scene(path)):
            return phrase("Add a file name that ends in {endings}", endings=endings)
        if not path.name.lower().endswith(self.suffixes) and (path.suffix or not self.folders):
            if not self.folders:
                return phrase("The name must end in {endings}", endings=endings)
            if self.fills:
                return phrase(
                    "The name must end in {endings}, or have no ending for a folder of pictures", endings=endings
                )
            return phrase("The name must end in {endings}, or have no ending for a scene folder", endings=endings)
        return _check_parent(path)


def _holds_anything(path: Path) -> bool:
    """Whether there is a file of this name, or a folder that is not empty or cannot be read."""
    try:
        return os.path.lexists(path) and (not os.path.isdir(path) or bool(os.listdir(path)))
    except OSError:
        return True


def _check_filled_folder(path: Path) -> str:
    """Say why many files cannot be written into this folder; empty if they can."""
    if os.path.isfile(path) or path.name.lower().endswith(FILE_ENDINGS):
        return "Many files will be written: enter the name of a folder"
    if holds_scene(path):
        return "That folder contains a scene; choose another"
    return _check_parent(path)


def _check_parent(path: Path) -> str:
    return "" if os.path.isdir(path.parent) else phrase("The folder {parent} does not exist", parent=path.parent)


def holds_scene(folder: Path) -> bool:
    """Whether a folder can be opened as a scene; False for one that cannot be read."""
    try:
        return is_scene_folder(folder)
    except OSError:
        return False


def _open(session: EditorSession, path: Path, _: Callable[[], None]) -> None:
    session.files.leave_for(path)


def _insert(session: EditorSession, path: Path, _: Callable[[], None]) -> None:
    session.insertion.insert(path)


def _save(session: EditorSession, path: Path, then: Callable[[], None]) -> None:
    session.files.save(path, then)


def _export(session: EditorSession, path: Path, _: Callable[[], None]) -> None:
    session.export.write(path)


def _export_keys(session: EditorSession, path: Path, _: Callable[[], None]) -> None:
    chosen = session.preferences.current
    try:
        write_keys(path, chosen.preset, chosen.keys)
    except DataError as error:
        session.messages.error(read_error(error))
    else:
        session.messages.info(phrase("Exported the keys to {path}", path=path))


def _import_keys(session: EditorSession, path: Path, _: Callable[[], None]) -> None:
    try:
        preset, keys = read_keys(path, session.actions.usual_keys)
    except DataError as error:
        session.messages.error(read_error(error))
    else:
        session.preferences.change(preset=preset, keys=keys)
        session.messages.info(phrase("The keys are now those of {name}", name=path.name))


def _read_way(session: EditorSession, path: Path, _: Callable[[], None]) -> None:
    try:
        session.ways.read_file(path)
    except (DataError, OptionError) as error:
        session.messages.error(read_error(error))


PURPOSES = {
    "open": FilePurpose("Open a scene or project", "Open", (SUFFIX, *SCENE_ENDINGS), _open),
    "insert": FilePurpose("Insert a scene", "Insert", SCENE_ENDINGS, _insert),
    "save": FilePurpose("Save the project", "Save", (SUFFIX,), _save, True, False, SUFFIX),
    "export_keys": FilePurpose("Export keys", "Export", (".json",), _export_keys, True, False, "_keys.json"),
    "import_keys": FilePurpose("Import keys", "Import", (".json",), _import_keys, folders=False),
    "read_way": FilePurpose("Read a way", "Read", (".json", ".xosc"), _read_way, folders=False),
    "export": FilePurpose("Export", "Export", WRITTEN, _export, True),
}
"""By `AskPath.purpose`; `AskExport` adapts the last one to what is exported."""
