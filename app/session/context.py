"""What the controllers of a session share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from instdrive_app.jobs import Jobs
from instdrive_app.messages import Messages
from instdrive_app.session.history_controller import HistoryController
from instdrive_app.session.requests import RequestQueue
from instdrive_app.state import EditorState
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit


@dataclass(frozen=True)
class SessionContext:
    """Handed to each controller; the open document changes, everything else stays."""

    state: EditorState
    history: HistoryController
    jobs: Jobs
    messages: Messages
    requests: RequestQueue
    wake: Callable[[], None]
    """Makes the window draw a frame; can be called from any thread."""

    @property
    def document(self) -> Document | None:
        """The open document."""
        return self.history.document

    def apply(self, edit: Edit | Callable[[], Edit], gesture: str | None = None) -> bool:
        """Edit the open document as `HistoryController.apply` does; returns whether the edit was done."""
        return self.history.apply(edit, gesture)
