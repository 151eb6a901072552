"""Says what a thing reaches into once it was put somewhere; nothing is forbidden."""

from __future__ import annotations

from instdrive_app.session.context import SessionContext
from instdrive_app.session.placing.settled_step import SettledStep
from instdrive_core.edits.document.frozen_copy import freeze_document
from instdrive_core.edits.kinds.light.cast_shadows import find_put
from instdrive_core.edits.queries.overlaps import Overlap, describe_overlap, find_overlaps, list_drive_times
from instdrive_core.wording import Phrase, count_phrase, phrase


class OverlapController:
    """Looks beside the window after each step that puts things somewhere, and tells the deepest overlap."""

    def __init__(self, context: SessionContext) -> None:
        self._context, self._step = context, SettledStep()

    def tick(self, seconds: float, is_dragging: bool) -> None:
        """Look once the last step stays for a moment; called once a frame."""
        document = self._context.document
        last = self._step.look(document, seconds, is_dragging)
        if document is None or last is None:
            return
        put, frozen = find_put(last), freeze_document(document)

        def work() -> tuple[tuple[Overlap, ...], Phrase | None]:
            found = find_overlaps(frozen, put.ids, list_drive_times(frozen), put.added)
            return found, describe_overlap(frozen, found[0]) if found else None

        def finish(result: tuple[tuple[Overlap, ...], Phrase | None]) -> None:
            found, text = result
            if text is not None and self._context.document is document:
                self._context.messages.info(text if len(found) == 1 else _join(text, len(found) - 1))

        self._context.jobs.submit_in_background("Looking for overlaps", work, finish)


def _join(text: Phrase, more: int) -> Phrase:
    others = count_phrase(more, "{count} more overlap", "{count} more overlaps")
    return phrase("{overlap}; {others}", overlap=text, others=others)
