"""Sources of a document's splats: its base scene and the files that edits insert, each with a digest."""

from __future__ import annotations

import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from instdrive_core.edits.document.document import Document
from instdrive_core.errors import DataError, SceneChangedError, SceneTooLargeError
from instdrive_core.formats.allocation import MEMORY_TO_EDIT
from instdrive_core.formats.registry import open_scene
from instdrive_core.formats.scene_files import FileIdentity, identify_scene, list_scene_files, sum_file_sizes
from instdrive_core.scene.scene import Scene

_ATTEMPTS = 3


@dataclass(frozen=True)
class SceneSource:
    """A scene as it was when it was opened."""

    path: Path
    """Absolute."""
    identity: FileIdentity
    keep_every: int = 1
    """k where only every k-th splat was opened."""


@dataclass(frozen=True)
class RecordedSource:
    """A scene as a project names it."""

    relative: str
    """Path from the project's folder, with ``/``; empty where there is none."""
    absolute: str
    identity: FileIdentity
    keep_every: int = 1
    """k where only every k-th splat was opened: edits name the splats that were opened."""

    def list_places(self, project: Path) -> list[Path]:
        """Where it may be, the likeliest first: beside the project as before, where it was, or in its folder."""
        folder = project.parent
        name = PurePosixPath(self.relative or Path(self.absolute).as_posix()).name
        named = [folder / self.relative] if self.relative else []
        return list(dict.fromkeys([*named, Path(self.absolute), folder / name]))


class SceneSources:
    """How a document opens the files that its edits insert; remembers what was opened.

    Args:
        base: the document's own scene.
        inserted: what was opened before, by the names that edits give it.
    """

    def __init__(self, base: SceneSource, inserted: Mapping[str, SceneSource] | None = None) -> None:
        self.base = base
        self.inserted = dict(inserted or {})
        self.cameras_note = ""
        """What the user should know about cameras found beside the base; empty where there are none."""

    def __call__(self, path: Path) -> Scene:
        """Open a file that an edit inserts; where it is not, but was found elsewhere before, that one."""
        known = self.inserted.get(str(path))
        scene, source = _open_whole(known.path if known and not path.exists() else path)
        self.inserted[str(path)] = source
        return scene


def has_cameras_beside(document: Document) -> bool:
    """Whether a document has its cameras from a file of another program beside its scene."""
    sources = document.open_scene
    return isinstance(sources, SceneSources) and bool(sources.cameras_note) and bool(document.scene.views)


def is_source(path: Path, document: Document) -> bool:
    """Whether a document's edits build on the file or folder `path`: written over, they would be done twice."""
    sources = document.open_scene
    if not isinstance(sources, SceneSources):
        return False
    return path.resolve() in {source.path.resolve() for source in (sources.base, *sources.inserted.values())}


class RecordedScenes:
    """How a project's edits open files while they are done again: recorded files must hold what they held.

    Args:
        recorded: by the names that edits give them.
        project: the file that recorded them.
        accept_changed: whether they may hold something else by now.
    """

    def __init__(self, recorded: Mapping[str, RecordedSource], project: Path, accept_changed: bool) -> None:
        self.found: dict[str, SceneSource] = {}
        """What was opened, by the names that edits give it."""
        self._recorded, self._project, self._accept_changed = recorded, project, accept_changed

    def __call__(self, path: Path) -> Scene:
        """Open what a project means by a name. Raises DataError, SceneChangedError."""
        recorded = self._recorded.get(str(path))
        opened = open_recorded_source(recorded, self._project, self._accept_changed) if recorded else _open_whole(path)
        scene, self.found[str(path)] = opened
        return scene


def get_sources(document: Document) -> SceneSources:
    """The sources of a document. Raises DataError where `open_document` did not open it."""
    if isinstance(document.open_scene, SceneSources):
        return document.open_scene
    raise DataError(
        "the document", "it comes from no file that edits could be kept for", "Export it, open the export, and go on"
    )


def open_scene_source(path: Path, keep_every: int = 1) -> tuple[Scene, SceneSource]:
    """Open a scene, or every k-th splat of it, and digest its files meanwhile.

    Raises DataError, SceneTooLargeError where there is not the memory to edit it.
    """
    path = path.absolute()
    try:
        # Both read the file; the digest, outside of Python's lock, costs no time of its own.
        with ThreadPoolExecutor(1) as digester:
            for _ in range(_ATTEMPTS):
                before = _list_stamps(path)
                identity = digester.submit(identify_scene, path)
                scene = open_scene(path, keep_every, MEMORY_TO_EDIT)
                if _list_stamps(path) == before:
                    return scene, SceneSource(path, identity.result(), keep_every)
    except OSError as error:
        raise DataError(path, f"it cannot be read ({error.strerror or error})", "Check its permissions") from error
    raise DataError(path, "it changes while it is opened", "Wait until the program that writes it is done")


def reopen_base(source: SceneSource) -> Scene:
    """Open a document's base again, as it is without edits. Raises SceneChangedError where it is another one by now."""
    scene, found = open_scene_source(source.path, source.keep_every)
    if found.identity != source.identity:
        raise SceneChangedError(source.path, source.path, source.identity.sha256, found.identity.sha256)
    return scene


def _open_whole(path: Path, keep_every: int = 1) -> tuple[Scene, SceneSource]:
    """Open a scene, but offer no smaller part of one that is too large: edits name the splats they mean."""
    try:
        return open_scene_source(path, keep_every)
    except SceneTooLargeError as error:
        raise SceneTooLargeError(path, error.count, error.needed, error.available, None) from error


def open_recorded_source(recorded: RecordedSource, project: Path, accept_changed: bool) -> tuple[Scene, SceneSource]:
    """Find a recorded scene and open it.

    Args:
        recorded: what to look for.
        project: the file that recorded it.
        accept_changed: whether to take what is there, though it is not what was edited.

    Raises DataError where it is not found, SceneChangedError where it is another one.
    """
    places = recorded.list_places(project)
    there = [place for place in places if place.is_file() or place.is_dir()]
    if not there:
        problem = f"a scene that it needs is not at {' nor at '.join(map(str, places))}"
        raise DataError(project, problem, f"Put it back, or into the folder {project.parent}")
    for place in there:
        if sum_file_sizes(list_scene_files(place)) == recorded.identity.size:
            scene, source = _open_whole(place, recorded.keep_every)
            if source.identity == recorded.identity:
                return scene, source
            del scene
    if accept_changed:
        return _open_whole(there[0], recorded.keep_every)
    raise SceneChangedError(project, there[0], recorded.identity.sha256, identify_scene(there[0]).sha256)


def record_source(source: SceneSource, project: Path) -> RecordedSource:
    """How a project file names a scene."""
    try:
        relative = Path(os.path.relpath(source.path, project.absolute().parent)).as_posix()
    except ValueError:  # another drive of Windows
        relative = ""
    return RecordedSource(relative, str(source.path), source.identity, source.keep_every)


def _list_stamps(path: Path) -> list[tuple[str, int, int]]:
    found = ((file, file.stat()) for file in list_scene_files(path))
    return [(str(file), stat.st_mtime_ns, stat.st_size) for file, stat in found]
