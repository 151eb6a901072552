"""Replaying kept edits on the scene that they were made for."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit
from instdrive_core.edits.serialize import edit_from_json
from instdrive_core.errors import DataError, EditError, SceneChangedError
from instdrive_core.project.cameras_beside import attach_cameras_beside
from instdrive_core.project.sources import RecordedScenes, RecordedSource, SceneSources, open_recorded_source


@dataclass(frozen=True)
class KeptHistory:
    """Edits in a file, and what they are for."""

    path: Path
    """The file, for messages; relative paths of scenes start in its folder."""
    base: RecordedSource
    inserted: Mapping[str, RecordedSource]
    cursor: int
    """How many of the edits are done in the end."""
    entries: Callable[[Document], Iterable[object]]
    """The edits as `Edit.to_json` gave them, read while they are done; gets the document as it is by then."""


def replay_history(kept: KeptHistory, accept_changed: bool) -> tuple[Document, tuple[str, ...]]:
    """Open the base scene, do all edits, then undo those from the cursor on, so that they can be redone.

    Args:
        kept: what to do again.
        accept_changed: whether scenes may have changed; edits that do not fit are left out then.

    Returns: the document, and one sentence for each edit that was left out.
    Raises DataError where the scene is not found or an edit does not fit, SceneChangedError for a scene that changed.
    """
    scene, source = open_recorded_source(kept.base, kept.path, accept_changed)
    attach_cameras_beside(scene, source.path)
    document = Document(scene)
    document.open_scene = scenes = RecordedScenes(kept.inserted, kept.path, accept_changed)
    left_out: list[str] = []
    done = 0
    for number, entry in enumerate(kept.entries(document), start=1):
        try:
            _do(document, edit_from_json(entry))
        except (EditError, DataError) as error:
            if not accept_changed:
                if isinstance(error, SceneChangedError):
                    raise
                remedy = "Open with accept_changed to leave such edits out"
                raise DataError(kept.path, _describe_left_out(number, error), remedy) from error
            left_out.append(_describe_left_out(number, error))
        else:
            done += number <= kept.cursor
    while document.history.cursor > done:
        document.undo()
    document.open_scene = SceneSources(source, scenes.found)
    return document, tuple(left_out)


def _describe_left_out(number: int, error: Exception) -> str:
    return f"edit {number} of the history cannot be done ({error})"


def _do(document: Document, edit: Edit) -> None:
    before = document.history.cursor
    document.apply(edit)
    if document.history.cursor == before:
        raise EditError(f"{edit.title} changes nothing")
