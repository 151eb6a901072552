"""The project of an improved scene: the edits of another project, made for it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit
from instdrive_core.project.carrying.edit_carrier import EditCarrier
from instdrive_core.project.carrying.parents_file import read_parents
from instdrive_core.project.carrying.row_origins import RowOrigins
from instdrive_core.project.document_check import compute_check
from instdrive_core.project.open import open_project
from instdrive_core.project.save import ProjectState, write_project
from instdrive_core.project.sources import SceneSources, get_sources, open_scene_source, reopen_base


@dataclass(frozen=True)
class CarriedEdits:
    """What became of a project's edits."""

    count: int
    """Edits of the new project, those undone included."""
    notes: tuple[str, ...]
    """A sentence for each edit that was left out."""


def carry_project(source: Path, run: Path, target: Path) -> CarriedEdits:
    """Write the project `target`: the history of the project `source`, for the scene in `run` that was trained on from
    that project's scene.

    What was done is done there, what was undone can be redone, and the view is the same.

    Raises DataError where one of them cannot be read or they do not belong together, SceneChangedError.
    """
    opened = open_project(source)
    history, sources = opened.document.history, get_sources(opened.document)
    edits = [edit.copy_undone() for edit in history.edits]
    cursor, view = history.cursor, opened.view
    del opened
    old = Document(reopen_base(sources.base))
    old.open_scene = SceneSources(sources.base, sources.inserted)
    parents = read_parents(run, len(old.scene))
    scene, base = open_scene_source(run)
    new = Document(scene)
    new.open_scene = known = SceneSources(base, sources.inserted)
    carrier = EditCarrier(old, new, RowOrigins(parents, len(old.scene)))
    carried: list[Edit] = []
    check, done = compute_check(new), 0
    for number, edit in enumerate(edits, start=1):
        result = carrier.carry(edit)
        if result is not None:
            carried.append(result)
        if number == cursor:
            check, done = compute_check(new), len(carried)
    write_project(target, ProjectState(tuple(carried), done, base, dict(known.inserted), check, view))
    return CarriedEdits(len(carried), tuple(carrier.left_out))
