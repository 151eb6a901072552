"""Doing kept edits again on the scene that they were made for."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from instdrive_core.edits.base import Edit
from instdrive_core.edits.document import Document
from instdrive_core.edits.serialize import edit_from_json
from instdrive_core.errors import DataError, EditError, SceneChangedError


def replay(
    document: Document, entries: Iterable[object], cursor: int, source: Path, accept_changed: bool
) -> tuple[str, ...]:
    """Do all edits, then undo those from the cursor on, so that they can be redone.

    Args:
        document: of the base scene, without history.
        entries: edits as `Edit.to_json` gave them.
        cursor: how many of them are done in the end.
        source: the file that holds them, for messages.
        accept_changed: whether edits that do not fit are left out.

    Returns: one sentence for each edit that was left out.
    Raises DataError for the first edit that does not fit, SceneChangedError where it inserts a file that has changed.
    """
    left_out: list[str] = []
    done = 0
    for number, entry in enumerate(entries, start=1):
        try:
            edit = edit_from_json(entry)
            _do(document, edit)
        except (EditError, DataError) as error:
            if isinstance(error, SceneChangedError) and not accept_changed:
                raise
            problem = f"edit {number} of the history cannot be done ({error})"
            if not accept_changed:
                raise DataError(source, problem, "Open with accept_changed to leave such edits out") from error
            left_out.append(problem)
            continue
        done += number <= cursor
    while document.history.cursor > done:
        document.undo()
    return tuple(left_out)


def _do(document: Document, edit: Edit) -> None:
    before = document.history.cursor
    document.apply(edit)
    if document.history.cursor == before:
        raise EditError(f"{edit.title} changes nothing")
