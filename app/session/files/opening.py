"""Opening scenes, projects and recovered work; runs on a background thread."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from instdrive_core.edits.document.document import Document
from instdrive_core.errors import say_ordinal
from instdrive_core.formats.registry import sketch_scene
from instdrive_core.progress import report, report_span
from instdrive_core.project.cameras_beside import attach_cameras_beside
from instdrive_core.project.open import open_document, open_project
from instdrive_core.project.recoverable import RecoverableSession, RestoredSession, restore_session
from instdrive_core.project.save import is_project
from instdrive_core.project.sources import get_sources
from instdrive_core.rasterize.sky_evidence import fill_scene_sky
from instdrive_core.scene.lint import Defect, find_defects
from instdrive_core.scene.scene import Scene
from instdrive_core.wording import phrase

MOST_LINTED = 2_000_000
"""Splats up to which defects are looked for before a scene is shown: 0.3 s per million."""


@dataclass(frozen=True)
class OpenedDocument:
    """A document, ready to be shown."""

    document: Document
    path: Path
    view: dict[str, Any] | None = None
    """The user's view when the project was saved."""
    notes: tuple[str, ...] = ()
    """What the user should know about the project."""
    defects: tuple[Defect, ...] | None = ()
    """What is wrong with the scene's splats; None where that is still to be found, as it takes seconds."""
    restored: RestoredSession | None = None
    """The recovered work, where the document comes from an editor that ended without saving."""


def sketch_document(path: Path) -> Document | None:
    """Make a document, only to be looked at, of the sparse sketch of a large scene; None where there is none."""
    scene = sketch_scene(path)
    if scene is None:
        return None
    attach_cameras_beside(scene, path)
    return Document(scene)


def open_for_editing(
    path: Path,
    accept_changed: bool = False,
    keep_every: int = 1,
    show_sketch: Callable[[Document], None] | None = None,
) -> OpenedDocument:
    """Open a scene file, a run folder or a project, and look for defective splats.

    Args:
        path: what to open.
        accept_changed: open a project also where its scene is no longer the one that was edited.
        keep_every: k opens every k-th splat of a scene.
        show_sketch: gets a sketch of a large scene, to be looked at while the whole is read.

    Raises DataError; SceneChangedError where the scene of a project has changed, SceneTooLargeError where it does not
    fit into memory.
    """
    report(0.0)
    if show_sketch is not None and not is_project(path):
        sketch = sketch_document(path)
        if sketch is not None:
            show_sketch(sketch)
    notes: tuple[str, ...] = ()
    with report_span(0.0, 0.9):
        if is_project(path):
            project = open_project(path, accept_changed)
            document, view, notes = project.document, project.view, project.notes
        else:
            document, view = open_document(path, keep_every=keep_every)
            if keep_every > 1:
                notes = (
                    phrase(
                        "Every {ordinal} splat was opened and made larger: {count:,} in all",
                        ordinal=say_ordinal(keep_every),
                        count=len(document.scene),
                    ),
                )
            note = get_sources(document).cameras_note
            notes = (*notes, note) if note else notes
    fill_document_sky(document)
    document.count_states()  # builds the index of instances here, so that the first click finds it built
    document.keep_instance_ids()  # as the first deletion needs them
    report(0.95)
    defects = list_defects(document.scene) if len(document.scene) <= MOST_LINTED else None
    return OpenedDocument(document, path, view, notes, defects)


def list_defects(scene: Scene) -> tuple[Defect, ...]:
    """List the defects of single splats."""
    return tuple(defect for defect in find_defects(scene) if len(defect.rows))


def fill_document_sky(document: Document) -> None:
    """Fill what no photo saw of the sky: scenes trained by earlier versions hold noise there.

    Where edits have turned the scene, its sky stays: undoing them would bring the old one back.
    """
    scene = document.scene
    if scene.sky is not None and scene.views and np.array_equal(document.orientation, np.eye(3, 4)):
        document.replace_surroundings(scene.views, fill_scene_sky(scene), document.orientation)


def recover_for_editing(session: RecoverableSession, accept_changed: bool = False) -> OpenedDocument:
    """Open a scene and replay the edits of an editor that ended without saving.

    `accept_changed` opens it also where the scene is no longer the one that was edited; else SceneChangedError is
    raised. Raises DataError.
    """
    found = restore_session(session, accept_changed)
    fill_document_sky(found.document)
    found.document.count_states()
    return OpenedDocument(found.document, found.path, notes=found.notes, restored=found)
