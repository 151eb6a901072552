"""What several menus share: when an action can be run, and asking the window for something."""

from __future__ import annotations

from collections.abc import Callable

from instdrive_app.action import Action
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.session.requests import Request
from instdrive_core.wording import drop_ellipsis, phrase

QUIET = frozenset({"Escape", "Enter", "Shift+Enter", "Ctrl+Enter", "Backspace"})
"""Keys that are pressed also where nothing is expected of them."""


def is_editable(session: EditorSession) -> bool:
    """Whether a document is open and no modal job waits or runs."""
    return session.document is not None and not session.jobs.is_blocking


def run_on_instances(session: EditorSession, run: Callable[[], object]) -> Callable[[], None]:
    """Make a callback that runs on the selected instances; selected splats of none become an instance first."""

    def run_named() -> None:
        if session.selection.name_loose_splats():
            run()

    return run_named


def explain_disabled(session: EditorSession, action: Action) -> str:
    """Say why an action cannot run now, in a sentence for the user."""
    if session.jobs.is_blocking and session.jobs.current is not None:
        return phrase("“{job}” is still running", job=phrase(session.jobs.current.title))
    if session.document is None:
        return "Open a scene first"
    if action.needs:
        return action.needs
    if session.selection.is_empty:
        return "Select something first"
    return "There is nothing for it to do now"


def run_or_explain(session: EditorSession, action: Action) -> None:
    """Run an action, or tell the user why it cannot run or that it changed nothing.

    The same is told once while it is on screen.
    """
    before = _list_traces(session)
    if session.actions.run(action.id):
        if not action.undoable or _list_traces(session) != before:
            return
        why: str = phrase("nothing needs to change")
    elif QUIET.intersection(action.shortcuts):
        return
    else:
        why = explain_disabled(session, action)
    reason = phrase("{command}: {reason}", command=drop_ellipsis(action.title), reason=phrase(why))
    if all(message.text != reason for message in session.messages.toasts):
        session.messages.info(reason)


def ask_to_wait(session: EditorSession) -> None:
    """Tell a user who wants more than look around in a sketch to wait for the scene; once while that is on screen."""
    text = "Please wait until the whole scene has been read. Meanwhile you can look around"
    if all(message.text != text for message in session.messages.toasts):
        session.messages.info(text)


def _list_traces(session: EditorSession) -> tuple[object, ...]:
    """What an action leaves that edits, asks, says or begins something."""
    history = session.document.history if session.document is not None else None
    steps = (len(history.edits), history.cursor, id(history.edits[-1]) if history.edits else 0) if history else ()
    log, path = session.messages.log, id(session.state.path_keys)
    return steps, path, session.requests.waiting, session.jobs.current, id(log[-1]) if log else 0


def put_request(session: EditorSession, request: Request) -> Callable[[], None]:
    """Make a callback that asks the window for something."""
    return lambda: session.requests.put(request)
