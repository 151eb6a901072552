"""Saving a project: the edits of a document, not its splats."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from safetensors.numpy import save

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit
from instdrive_core.errors import DataError
from instdrive_core.files.archive import MAX_MEMBERS, add_member
from instdrive_core.files.atomic import open_atomically
from instdrive_core.project.document_check import DocumentCheck, compute_check
from instdrive_core.project.manifest import Manifest, find_program_version, manifest_to_json
from instdrive_core.project.packed_lists import Numbers, pack_lists
from instdrive_core.project.sources import SceneSource, get_sources, record_source

SUFFIX = ".instdrive"
MANIFEST, EDITS, VIEW = "manifest.json", "edits.jsonl", "view.json"
ARRAYS = "arrays/{number}.safetensors"
ARRAY = "values"
"""The name within a member of `ARRAYS`."""


@dataclass(frozen=True)
class ProjectState:
    """The content of a project file, taken at one moment: it can be written while the user goes on editing."""

    edits: tuple[Edit, ...]
    cursor: int
    base: SceneSource
    inserted: Mapping[str, SceneSource]
    check: DocumentCheck
    view: Mapping[str, Any] | None = None


def is_project(path: Path) -> bool:
    """Whether a path is called as projects are."""
    return path.name.lower().endswith(SUFFIX)


def capture_project_state(document: Document, view: Mapping[str, Any] | None = None) -> ProjectState:
    """All edits of a document, those undone included, and the editor's view of it.

    Args:
        document: from `open_document`.
        view: anything that JSON can hold; given back as it is.

    Raises DataError where the document does not come from a file.
    """
    history, sources = document.history, get_sources(document)
    check, inserted = compute_check(document), dict(sources.inserted)
    return ProjectState(history.edits, history.cursor, sources.base, inserted, check, view)


def save_project(path: str | Path, document: Document, view: Mapping[str, Any] | None = None) -> None:
    """Write the project of a document, atomically. Arguments and errors as those of the two functions it calls."""
    write_project(path, capture_project_state(document, view))


def write_project(path: str | Path, state: ProjectState) -> None:
    """Write a project, atomically: `path` is the old file or the new one, whole, whatever happens.

    Raises DataError where the name does not end in .instdrive or the system does not let the file be written.
    """
    path = Path(path)
    if not is_project(path):
        raise DataError(path, f"projects are called NAME{SUFFIX}", f"Save as {path.name}{SUFFIX}")
    try:
        view = None if state.view is None else json.dumps(state.view, allow_nan=False).encode()
    except (TypeError, ValueError, RecursionError) as error:
        raise DataError(path, f"the view cannot be kept as JSON ({error})", "Give plain values only") from error
    with open_atomically(path) as file, zipfile.ZipFile(file, "w") as archive:
        members = _write_edits(path, archive, state.edits)
        if view is not None:
            add_member(archive, VIEW, view)
            members.append(VIEW)
        add_member(archive, MANIFEST, manifest_to_json(_make_manifest(path, state, members)))


def _write_edits(path: Path, archive: zipfile.ZipFile, edits: tuple[Edit, ...]) -> list[str]:
    members: list[str] = []

    def keep(numbers: Numbers) -> str:
        if len(members) == MAX_MEMBERS - 3:
            problem = f"it has over {len(members)} selections by region, more than a project can hold"
            raise DataError(path, problem, "Export the scene, open the export, and go on with that")
        members.append(ARRAYS.format(number=len(members)))
        add_member(archive, members[-1], save({ARRAY: numbers}))
        return members[-1]

    lines = [json.dumps(pack_lists(edit, keep)) + "\n" for edit in edits]
    add_member(archive, EDITS, "".join(lines).encode())
    return [*members, EDITS]


def _make_manifest(path: Path, state: ProjectState, members: list[str]) -> Manifest:
    return Manifest(
        find_program_version(),
        datetime.now(UTC).astimezone().isoformat(timespec="seconds"),
        record_source(state.base, path),
        {name: record_source(source, path) for name, source in state.inserted.items()},
        len(state.edits),
        state.cursor,
        state.check,
        tuple(members),
    )
