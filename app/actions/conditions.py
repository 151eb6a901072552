"""What several menus share: when a command can be run, and opening a dialog."""

from __future__ import annotations

from collections.abc import Callable

from instdrive_app.session.editor_session import EditorSession


def is_editable(session: EditorSession) -> bool:
    """Whether a document is open and no modal work is under way."""
    return session.document is not None and not session.jobs.blocking


def asking(session: EditorSession, dialog: str) -> Callable[[], None]:
    """A callback that opens the dialog of this name."""

    def run() -> None:
        session.dialog = dialog

    return run
