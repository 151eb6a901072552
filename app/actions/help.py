"""Looking things up."""

from __future__ import annotations

from instdrive_app.action import Action
from instdrive_app.actions.conditions import put_request
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.session.requests import ShowAbout, ShowPalette, ShowShortcuts


def list_actions(session: EditorSession) -> list[Action]:
    """List the Help menu."""

    def show_first_steps() -> None:
        session.state.shows_first_steps = True

    return [
        Action(
            "help.palette",
            "Find a command…",
            put_request(session, ShowPalette()),
            "Help",
            ("Ctrl+P",),
            icon="ICON_FA_TERMINAL",
        ),
        Action(
            "help.shortcuts",
            "Keys and mouse",
            put_request(session, ShowShortcuts()),
            "Help",
            ("F1",),
            icon="ICON_FA_KEYBOARD",
            words=("hotkeys", "shortcuts", "keyboard"),
        ),
        Action(
            "help.first_steps",
            "Show first steps",
            show_first_steps,
            "Help",
            enabled=lambda: session.document is not None,
            icon="ICON_FA_SHOE_PRINTS",
            words=("introduction", "tutorial", "welcome", "how to"),
        ),
        Action(
            "help.log",
            "Log file and version…",
            put_request(session, ShowAbout()),
            "Help",
            icon="ICON_FA_CIRCLE_INFO",
            separator=True,
        ),
    ]
