"""The last step, once it stays: what was put somewhere is dealt with when the user lets go of it."""

from __future__ import annotations

from weakref import ref

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit
from instdrive_core.edits.kinds.light.cast_shadows import find_put

SETTLE_SECONDS = 0.4
"""Time for which an edit stays the last step before what it has put somewhere is dealt with."""


class SettledStep:
    """Watches the history for steps that put things somewhere; gives each once."""

    def __init__(self) -> None:
        self._looked: tuple[ref[Document], Edit | None] | None = None
        """The document, and its last step that was dealt with."""
        self._waited = 0.0
        self._last: Edit | None = None

    def look(self, document: Document | None, seconds: float, is_dragging: bool) -> Edit | None:
        """The last step where it has just settled, else None; called once a frame, `seconds` after the one before."""
        last = document.history.done[-1] if document is not None and document.history.done else None
        if document is None or self._looked is None or self._looked[0]() is not document:
            # What was done before a document was opened stays as it was saved.
            self._looked = None if document is None else (ref(document), last)
            return None
        is_new = last is not self._looked[1] and document.history.next is None
        if last is None or not is_new or not find_put(last).ids:
            self._looked, self._last = (ref(document), last), None
            return None
        self._waited = self._waited + seconds if self._last is last else 0.0
        self._last = last
        if self._waited < SETTLE_SECONDS or is_dragging:
            return None
        self._looked = (ref(document), last)
        return last

    def replace(self, document: Document, edit: Edit) -> None:
        """Take an edit that stands for the last step now as dealt with."""
        self._looked = (ref(document), edit)
