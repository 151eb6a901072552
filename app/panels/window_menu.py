"""The Window menu, which brings panels to the front."""

from __future__ import annotations

from instdrive_app.action import Action
from instdrive_app.actions.conditions import put_request
from instdrive_app.panels.registry import PANELS
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.session.requests import ShowPanel


def list_panel_actions(session: EditorSession) -> list[Action]:
    """List one action per panel, in the order of the tabs."""
    listed = (record for record in PANELS if not record.fills_window)
    return [
        Action(
            f"panel.{record.title.lower()}",
            record.title,
            put_request(session, ShowPanel(record.title)),
            "Window",
            (record.shortcut,) if record.shortcut else (f"Alt+{number % 10}",) if number <= 10 else (),
            icon=record.icon,
        )
        for number, record in enumerate(listed, start=1)
    ]
