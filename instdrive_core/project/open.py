"""Opening scenes and projects as documents."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from safetensors import SafetensorError
from safetensors.numpy import load

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.errors import DataError, OptionError, format_ordinal
from instdrive_core.files.archive import ARCHIVE_REMEDY, Archive, open_project_archive
from instdrive_core.files.bounded_json import parse_bounded_json
from instdrive_core.formats.registry import open_scene
from instdrive_core.project.cameras_beside import attach_cameras_beside
from instdrive_core.project.document_check import compute_check
from instdrive_core.project.manifest import Manifest, OtherVersionError, manifest_from_json
from instdrive_core.project.packed_lists import Numbers, unpack_lists
from instdrive_core.project.replay import KeptHistory, replay_history
from instdrive_core.project.save import ARRAY, EDITS, MANIFEST, VIEW, is_project
from instdrive_core.project.sources import SceneSources, open_scene_source
from instdrive_core.scene.scene import Scene

_MAX_MANIFEST, _MAX_VIEW, _MAX_LINE = 16 << 20, 16 << 20, 16 << 20
_NUMBERS_PER_SPLAT = 4
"""A list of an edit names every splat once, or runs of splats by two numbers each."""


@dataclass(frozen=True)
class OpenedProject:
    """A project, opened."""

    document: Document
    view: dict[str, Any] | None
    """The view that was handed to `save_project`."""
    notes: tuple[str, ...] = ()
    """Sentences for the user about what differs from the saved state, such as edits left out."""


def open_document(
    path: str | Path, accept_changed: bool = False, keep_every: int = 1
) -> tuple[Document, dict[str, Any] | None]:
    """Open a scene, or a project with its history; edits of the document can insert files.

    Args:
        path: scene file, scene or run folder, or project.
        accept_changed: as in `open_project`.
        keep_every: as in `open_scene`; a project of such a document remembers it.

    Returns: the document, and the view kept in a project.
    Raises DataError, also as `open_project` does; SceneTooLargeError where there is not the memory to edit the scene.
    """
    path = Path(path)
    if is_project(path):
        check_whole(path, keep_every)
        project = open_project(path, accept_changed)
        return project.document, project.view
    scene, source = open_scene_source(path, keep_every)
    beside = attach_cameras_beside(scene, path)
    document = Document(scene)
    sources = document.open_scene = SceneSources(source)
    sources.cameras_note = beside.note if beside is not None else ""
    return document, None


def open_project(path: str | Path, accept_changed: bool = False) -> OpenedProject:
    """Open the scene of a project and do its edits again.

    Args:
        path: the project file.
        accept_changed: open also where the scene or an inserted file is no longer the one that was edited, and leave
            out edits that do not fit; `OpenedProject.notes` says which.

    Raises DataError where the project is damaged, or its scene is not found; SceneChangedError where it is another.
    """
    path = Path(path)
    with open_project_archive(path) as archive:
        manifest = _read_manifest(archive)
        view = _read_view(archive) if VIEW in archive.names else None
        # The user vouches for a project whose scene has changed: its lists may be longer than this scene.
        splats = manifest.check.splats if accept_changed else 0

        def entries(document: Document) -> Iterator[object]:
            return _read_entries(archive, manifest, document, splats)

        kept = KeptHistory(path, manifest.base, manifest.inserted, manifest.cursor, entries)
        document, notes = replay_history(kept, accept_changed)
    if not notes and compute_check(document) != manifest.check:
        notes = (f"The edits gave another result than when they were saved (by version {manifest.program})",)
    return OpenedProject(document, view, notes)


def read_project_view(path: str | Path) -> dict[str, Any]:
    """Read what a project keeps beside its edits, without opening its scene. Raises DataError for a damaged one."""
    with open_project_archive(Path(path)) as archive:
        return _read_view(archive) if VIEW in archive.names else {}


def locate_project_base(path: Path) -> Path:
    """Locate the scene that a project's edits are of, without opening it: the likeliest place where something is.

    Raises DataError for a damaged project.
    """
    with open_project_archive(path) as archive:
        places = _read_manifest(archive).base.list_places(path.absolute())
    return next((place for place in places if place.exists()), places[0])


def open_edited_scene(
    path: str | Path, keep_every: int = 1, time: float | None = None, data: Path | None = None
) -> Scene:
    """Open a scene, or the scene that the edits of a project make; tracks stay tracks.

    Raises DataError, SceneTooLargeError; other arguments as in `open_scene`.
    """
    path = Path(path)
    if not is_project(path):
        return open_scene(path, keep_every, time=time, data=data)
    if data is not None:
        raise OptionError(f"{path} is a project, which has its tracks already; leave the data set's folder {data} out")
    check_whole(path, keep_every)
    return bake_document(open_project(path).document)


def check_whole(path: Path, keep_every: int) -> None:
    """Raises OptionError where a part of a project is asked for."""
    if keep_every != 1:
        raise OptionError(
            f"{path} cannot be opened in part, as its edits name splats; open every "
            f"{format_ordinal(keep_every)} splat of the scene itself and save that as another project"
        )


def _read_manifest(archive: Archive) -> Manifest:
    try:
        manifest = manifest_from_json(archive.read(MANIFEST, _MAX_MANIFEST))
    except OtherVersionError as error:
        raise DataError(archive.path, str(error), "Update InstDrive") from error
    except ValueError as error:
        raise DataError(archive.path, f"{MANIFEST} is damaged: {error}", ARCHIVE_REMEDY) from error
    if unlike := archive.names ^ {MANIFEST, *manifest.members}:
        problem = f"the archive and its manifest do not agree about {min(unlike)[:200]!r}"
        raise DataError(archive.path, problem, ARCHIVE_REMEDY)
    return manifest


def _read_view(archive: Archive) -> dict[str, Any]:
    try:
        view = parse_bounded_json(archive.read(VIEW, _MAX_VIEW))
    except ValueError as error:
        raise DataError(archive.path, f"{VIEW} is damaged: {error}", ARCHIVE_REMEDY) from error
    if not isinstance(view, dict):
        raise DataError(archive.path, f"{VIEW} holds a {type(view).__name__}, not an object", ARCHIVE_REMEDY)
    return view


def _read_entries(archive: Archive, manifest: Manifest, document: Document, splats: int) -> Iterator[object]:
    """The edits one by one: a history that unfolds absurdly far is refused by its first edit that does not fit."""

    def numbers(name: object) -> Numbers:
        return _read_numbers(archive, name, _NUMBERS_PER_SPLAT * max(splats, len(document.scene)))

    number = 0
    with archive.open_member(EDITS) as lines:
        while line := lines.readline(_MAX_LINE + 1):
            number += 1
            try:
                if len(line) > _MAX_LINE:
                    raise ValueError(f"it has more than {_MAX_LINE} bytes")
                entry = parse_bounded_json(line)
            except ValueError as error:
                raise DataError(
                    archive.path, f"line {number} of {EDITS} is damaged: {error}", ARCHIVE_REMEDY
                ) from error
            yield unpack_lists(entry, numbers)
    if number != manifest.edits:
        raise DataError(archive.path, f"{EDITS} holds {number} edits, not {manifest.edits}", ARCHIVE_REMEDY)


def _read_numbers(archive: Archive, name: object, limit: int) -> Numbers:
    """A list of at most `limit` numbers."""
    if not isinstance(name, str):
        raise DataError(archive.path, f"{name!r} stands where an array's name should", ARCHIVE_REMEDY)
    data = archive.read(name, 8 * limit + 4096)
    try:
        # The array's size is checked against the member's before anything is allocated.
        numbers = load(data)[ARRAY]
    except (SafetensorError, KeyError, ValueError, TypeError) as error:
        raise DataError(archive.path, f"{name!r} is damaged ({error})", ARCHIVE_REMEDY) from error
    if numbers.dtype.kind != "i" or numbers.ndim not in (1, 2) or math.prod(numbers.shape) > limit:
        problem = f"{name!r} is a {numbers.dtype} array of shape {numbers.shape}, no list of whole numbers"
        raise DataError(archive.path, problem, ARCHIVE_REMEDY)
    return numbers
