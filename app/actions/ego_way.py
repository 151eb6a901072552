"""Drawing a way for the recording car on the map."""

from __future__ import annotations

from instdrive_app.action import Action
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.session.requests import ShowPanel

_WORDS = ("ego", "path", "trajectory", "route", "simulate", "record", "drive", "map")


def list_actions(session: EditorSession) -> list[Action]:
    """List the part of the Move menu about the recording car."""
    way = session.ego_way

    def has_drive() -> bool:
        return session.document is not None and session.cameras.trace_way() is not None

    def toggle() -> None:
        way.toggle_drawing()
        if way.is_drawing:
            session.requests.put(ShowPanel("Map"))

    return [
        Action(
            "ego.draw",
            "Draw a way for the recording car",
            toggle,
            "Move",
            enabled=has_drive,
            checked=lambda: way.is_drawing,
            icon="ICON_FA_PEN",
            words=_WORDS,
            needs="The scene has no drive that could be recorded another way",
            separator=True,
        ),
        Action(
            "ego.drop_last",
            "Take the last place of the drawn way away",
            way.drop_last,
            "Move",
            enabled=lambda: bool(way.places),
            icon="ICON_FA_DELETE_LEFT",
            words=_WORDS,
            needs="Draw a way for the recording car first",
        ),
        Action(
            "ego.clear",
            "Clear the drawn way",
            way.clear,
            "Move",
            enabled=lambda: bool(way.places),
            icon="ICON_FA_ERASER",
            words=_WORDS,
            needs="Draw a way for the recording car first",
        ),
    ]
