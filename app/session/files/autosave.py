"""The recovery journal of the open document, and the work of editors that ended without saving."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from instdrive_app.messages import read_error
from instdrive_core.edits.document.document import Document
from instdrive_core.errors import DataError
from instdrive_core.project.recoverable import RecoverableSession, RestoredSession, discard_session
from instdrive_core.project.recovery import Recovery
from instdrive_core.project.save import ProjectState


class Autosave:
    """Journals the edits of one document at a time. A problem is reported once; editing goes on without a journal."""

    def __init__(self, report_error: Callable[[str], None]) -> None:
        self._report_error = report_error
        self._recovery: Recovery | None = None
        self.recoverable: list[RecoverableSession] = []
        """Work that the user is asked about."""

    def follow(self, document: Document, path: Path, restored: RestoredSession | None = None) -> None:
        """Journal the edits of a document opened from `path`, or restored, instead of those of the one before."""
        self.end()
        try:
            self._recovery = Recovery.begin(document, path, restored=restored)
        except DataError as error:
            self._report_error(read_error(error))

    def tick(self) -> None:
        """Record new edits; called once a frame."""
        if self._recovery is None:
            return
        self._recovery.record()
        problem = self._recovery.take_problem()
        if problem is not None:
            self._report_error(read_error(problem))

    def note_save(self, path: Path, state: ProjectState) -> None:
        """Note that the document's project was written."""
        if self._recovery is not None:
            self._recovery.mark_saved(path, state)

    def discard(self, session: RecoverableSession) -> None:
        """Delete the work of an editor that ended without saving, for good."""
        self.forget(session)
        try:
            discard_session(session)
        except DataError as error:
            self._report_error(read_error(error))

    def forget(self, session: RecoverableSession) -> None:
        """Ask no more about a session; the next editor offers it again."""
        self.recoverable = [other for other in self.recoverable if other is not session]

    def end(self) -> None:
        """Remove the journal, since the user has closed the document."""
        if self._recovery is not None:
            self._recovery.end()
            self._recovery = None
