"""Going to another step of the history: hundreds of edits take seconds, so each frame does some of them."""

from __future__ import annotations

import time

from instdrive_core.edits.document.document import Document

SLICE_SECONDS = 0.03
"""Of a frame that edits are undone or done in; the edit that is begun then is finished."""
FEWEST_STEPS = 3
"""Done in one frame however long they take: most jumps are over at once."""


class HistoryController:
    """One jump at a time; between two frames the document is in the state after some whole edit."""

    def __init__(self) -> None:
        self._document: Document | None = None
        self._cursor = 0

    @property
    def under_way(self) -> bool:
        """Whether edits are still to be undone or done."""
        return self._document is not None

    def to(self, document: Document, cursor: int) -> None:
        """Begin to go to where `cursor` edits are done, or as far as there are any; instead of where it was going."""
        self._document, self._cursor = document, min(max(cursor, 0), len(document.history.edits))
        self.tick()

    def stop(self) -> None:
        """Stay where it has come to."""
        self._document = None

    def tick(self) -> None:
        """Once a frame: go on."""
        document, until = self._document, time.perf_counter() + SLICE_SECONDS
        if document is None:
            return
        steps = 0
        while document.history.cursor != self._cursor:
            if steps >= FEWEST_STEPS and time.perf_counter() > until:
                return
            # Stopped first: an edit that cannot be done again ends the jump, and the error is the caller's.
            self._document = None
            moved = document.undo() if document.history.cursor > self._cursor else document.redo()
            if moved is None:
                return
            self._document = document
            steps += 1
        self._document = None
