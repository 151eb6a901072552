"""What the user can look up."""

from __future__ import annotations

from instdrive_app.action import Action
from instdrive_app.actions.conditions import asking
from instdrive_app.session.editor_session import EditorSession


def list_actions(session: EditorSession) -> list[Action]:
    """The Help menu."""
    return [
        Action(
            "help.palette", "Find a command…", asking(session, "palette"), "Help", ("Ctrl+P",), icon="ICON_FA_TERMINAL"
        ),
        Action(
            "help.shortcuts",
            "Keys and mouse",
            asking(session, "shortcuts"),
            "Help",
            ("F1",),
            icon="ICON_FA_KEYBOARD",
        ),
        Action(
            "help.log",
            "Log file and version…",
            asking(session, "about"),
            "Help",
            icon="ICON_FA_CIRCLE_INFO",
            separator=True,
        ),
    ]
