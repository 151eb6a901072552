"""What the parts of the session have in common."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from instdrive_app.jobs import Jobs
from instdrive_app.messages import Messages
from instdrive_app.state import EditorState
from instdrive_core.edits.document.document import Document


@dataclass(frozen=True)
class SessionContext:
    """Handed to each part; which document is open changes, the rest stays."""

    state: EditorState
    document: Callable[[], Document | None]
    """The open one."""
    apply: Callable[..., bool]
    """Makes and does an edit of the open document, and tells the user what hinders it."""
    jobs: Jobs
    messages: Messages
