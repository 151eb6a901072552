"""Bringing panels to the front."""

from __future__ import annotations

from instdrive_app.action import Action
from instdrive_app.actions.conditions import put_request
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.session.requests import ShowPanel

PANELS = {
    "Instances": "ICON_FA_LIST",
    "Inspector": "ICON_FA_SLIDERS",
    "History": "ICON_FA_CLOCK_ROTATE_LEFT",
    "Timeline": "ICON_FA_FILM",
    "Log": "ICON_FA_RECEIPT",
}
"""Names, as on the tabs, and icons."""


def list_actions(session: EditorSession) -> list[Action]:
    """The Window menu."""

    return [
        Action(
            f"panel.{name.lower()}",
            name,
            put_request(session, ShowPanel(name)),
            "Window",
            (f"Alt+{number}",),
            icon=symbol,
        )
        for number, (name, symbol) in enumerate(PANELS.items(), start=1)
    ]
