"""The open document and its history: doing edits, undoing them, and going to another step."""

from __future__ import annotations

import time
from collections.abc import Callable

from instdrive_app.jobs import Jobs
from instdrive_app.messages import Messages, user_message
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit
from instdrive_core.errors import EditError

SLICE_SECONDS = 0.03
"""Time in each frame for the edits of a jump; an edit that has begun is finished."""
FEWEST_STEPS = 3
"""Edits of a jump done in one frame however long they take: most jumps are over at once."""


class HistoryController:
    """Holds the open document; every edit of it goes through here.

    A jump over hundreds of edits takes seconds, so each frame does some of them. Between two frames the document is in
    the state after some whole edit.
    """

    def __init__(self, jobs: Jobs, messages: Messages) -> None:
        self._jobs, self._messages = jobs, messages
        self._document: Document | None = None
        self._target: int | None = None
        """Number of done edits that a jump leads to."""

    @property
    def document(self) -> Document | None:
        """The open document."""
        return self._document

    @property
    def is_jumping(self) -> bool:
        """Whether a jump is under way."""
        return self._target is not None

    def enter(self, document: Document) -> None:
        """Make a document the open one."""
        self.stop_jump()
        self._document = document

    def apply(self, edit: Edit | Callable[[], Edit], gesture: str | None = None) -> bool:
        """Do an edit, which may still have to be made; returns whether it was done.

        Edits of one `gesture` become one step. Tells the user what prevents an edit, or making it.
        """
        if self._document is None:
            return False
        if self._jobs.is_blocking or self.is_jumping:
            self._messages.error("Please wait until the current task has finished")
            return False
        try:
            self._document.apply(edit if isinstance(edit, Edit) else edit(), gesture)
        except EditError as error:
            self._messages.error(user_message(error))
            return False
        return True

    def undo(self) -> None:
        """Undo one step; does nothing while a modal job runs."""
        if self._document is not None and not self._jobs.is_blocking:
            self.stop_jump()
            self._document.undo()

    def redo(self) -> None:
        """Redo one step; does nothing while a modal job runs."""
        if self._document is not None and not self._jobs.is_blocking:
            self.stop_jump()
            self._document.redo()

    def jump(self, cursor: int) -> None:
        """Undo or redo until `cursor` edits are done, or as many as there are: a few now, more in later frames."""
        if self._document is not None and not self._jobs.is_blocking:
            self._target = min(max(cursor, 0), len(self._document.history.edits))
            self.tick()

    def stop_jump(self) -> None:
        """Stay where a jump has come to."""
        self._target = None

    def tick(self) -> None:
        """Continue a jump; called once a frame."""
        document, target, until = self._document, self._target, time.perf_counter() + SLICE_SECONDS
        if document is None or target is None:
            return
        steps = 0
        while document.history.cursor != target:
            if steps >= FEWEST_STEPS and time.perf_counter() > until:
                return
            # Stopped first: an edit that cannot be done again ends the jump, and the error is the caller's.
            self._target = None
            moved = document.undo() if document.history.cursor > target else document.redo()
            if moved is None:
                return
            self._target = target
            steps += 1
        self._target = None
