"""Completing selected things of which one side was never seen."""

from __future__ import annotations

from instdrive_app.messages import user_message
from instdrive_app.session.context import SessionContext
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit, describe_ids
from instdrive_core.edits.document.frozen_copy import freeze_colored
from instdrive_core.edits.kinds.compound import CompoundEdit
from instdrive_core.edits.kinds.shape.complete import CompleteInstance, make_completion
from instdrive_core.errors import EditError
from instdrive_core.progress import report
from instdrive_core.wording import format_count, phrase

Ids = tuple[int, ...]


class CompletionController:
    """Looks for planes of symmetry in the background and mirrors what was seen; says why something cannot be done."""

    def __init__(self, context: SessionContext) -> None:
        self._context, self._jobs, self._messages = context, context.jobs, context.messages

    def complete(self, ids: Ids) -> None:
        """Complete instances, as one step."""
        document = self._context.document
        if document is None or not ids:
            return
        frozen, seen = freeze_colored(document), document.history.cursor
        names = {number: document.scene.table[number].name for number in ids}

        def look() -> tuple[list[CompleteInstance], list[str]]:
            found, reasons = list[CompleteInstance](), list[str]()
            for place, number in enumerate(ids):
                report(place / len(ids))
                try:
                    found.append(make_completion(frozen, number))
                except EditError as error:
                    reasons.append(user_message(error))
            _prepare(found, frozen)
            return found, reasons

        def finish(result: tuple[list[CompleteInstance], list[str]]) -> None:
            found, reasons = result
            if self._context.document is not document:
                return
            if document.history.cursor != seen:  # it was edited in the meantime: look again
                self.complete(tuple(number for number in ids if number in document.scene.table))
                return
            title = (
                phrase("Complete {objects}", objects=describe_ids(tuple(edit.id for edit in found))) if found else ""
            )
            if found and self._context.apply(lambda: _join(found, title)):
                what = names[found[0].id] if len(found) == 1 else format_count(len(found), "thing")
                self._messages.info(
                    phrase("{what}: the unseen side is now the mirror image of the other one", what=what)
                )
            for reason in reasons[:1] if found else reasons[:3]:
                self._messages.error(reason)

        self._jobs.submit("Looking for symmetry", look, finish, modal=False)


def _prepare(edits: list[CompleteInstance], frozen: Document) -> None:
    """Work out beside the window what one edit after the other adds; all but the last are done to the copy."""
    for place, edit in enumerate(edits):
        edit.prepare(frozen)
        if place < len(edits) - 1:
            edit.do(frozen)


def _join(edits: list[CompleteInstance], title: str) -> Edit:
    return edits[0] if len(edits) == 1 else CompoundEdit(tuple(edits), title)
