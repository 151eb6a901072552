"""What several menus share: when an action can be run, and asking the window for something."""

from __future__ import annotations

from collections.abc import Callable

from instdrive_app.session.editor_session import EditorSession
from instdrive_app.session.requests import Request


def is_editable(session: EditorSession) -> bool:
    """Whether a document is open and no modal job waits or runs."""
    return session.document is not None and not session.jobs.is_blocking


def put_request(session: EditorSession, request: Request) -> Callable[[], None]:
    """Make a callback that asks the window for something."""
    return lambda: session.requests.put(request)
