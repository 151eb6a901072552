"""The open document's recovery journal, and what editors that died have left."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from instdrive_core.edits.document.document import Document
from instdrive_core.errors import DataError
from instdrive_core.project.recoverable import RecoverableSession, RestoredSession, discard_session
from instdrive_core.project.recovery import Recovery
from instdrive_core.project.save import ProjectState


class Autosave:
    """Follows one document at a time. What goes wrong is told once; editing goes on without."""

    def __init__(self, report_error: Callable[[str], None]) -> None:
        self._report_error = report_error
        self._recovery: Recovery | None = None
        self.recoverable: list[RecoverableSession] = []
        """What the user is asked about."""

    def follow(self, document: Document, path: Path, restored: RestoredSession | None = None) -> None:
        """Keep the edits of a document that was opened from `path`, or restored; no longer those of the one before."""
        self.end()
        try:
            self._recovery = Recovery.begin(document, path, restored=restored)
        except DataError as error:
            self._report_error(str(error))

    def tick(self) -> None:
        """Once a frame: note what is new."""
        if self._recovery is None:
            return
        self._recovery.record()
        problem = self._recovery.take_problem()
        if problem is not None:
            self._report_error(str(problem))

    def note_save(self, path: Path, state: ProjectState) -> None:
        """The document's project was written."""
        if self._recovery is not None:
            self._recovery.mark_saved(path, state)

    def discard(self, session: RecoverableSession) -> None:
        """Remove what a dead editor left, for good."""
        self.forget(session)
        try:
            discard_session(session)
        except DataError as error:
            self._report_error(str(error))

    def forget(self, session: RecoverableSession) -> None:
        """Ask no longer about a session; it is offered again by the next editor."""
        self.recoverable = [other for other in self.recoverable if other is not session]

    def end(self) -> None:
        """The document is closed by the user's will."""
        if self._recovery is not None:
            self._recovery.end()
            self._recovery = None
