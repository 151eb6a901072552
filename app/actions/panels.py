"""Bringing panels to the front."""

from __future__ import annotations

from collections.abc import Callable

from instdrive_app.action import Action
from instdrive_app.session.editor_session import EditorSession

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

    def showing(name: str) -> Callable[[], None]:
        def run() -> None:
            session.panel = name

        return run

    return [
        Action(f"panel.{name.lower()}", name, showing(name), "Window", (f"Alt+{number}",), icon=symbol)
        for number, (name, symbol) in enumerate(PANELS.items(), start=1)
    ]
