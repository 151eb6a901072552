"""The keys of the selected thing's way."""

from __future__ import annotations

from instdrive_app.action import Action
from instdrive_app.actions.conditions import put_request
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.session.requests import AskPath, ShowPanel

_WORDS = ("path", "track", "keys", "drive", "trajectory", "vehicle", "speed")


def list_actions(session: EditorSession) -> list[Action]:
    """List the part of the Move menu about keys of ways."""
    ways = session.ways
    return [
        Action(
            "way.add",
            "Add a key to the way now",
            lambda: ways.add(session.state.time),
            "Move",
            enabled=lambda: session.document is not None and ways.drives,
            icon="ICON_FA_PLUS",
            words=_WORDS,
            needs="Select something that drives",
            separator=True,
            undoable=True,
        ),
        Action(
            "way.delete",
            "Delete the chosen key of the way",
            ways.delete_chosen,
            "Move",
            enabled=lambda: session.document is not None and ways.chosen is not None and len(ways.keys) > 1,
            icon="ICON_FA_MINUS",
            words=_WORDS,
            needs="Take the path tool (Shift+T) and click a key first",
            undoable=True,
        ),
        Action(
            "way.read",
            "Read the way from a file…",
            put_request(session, AskPath("read_way")),
            "Move",
            enabled=lambda: session.document is not None and ways.subject != 0,
            icon="ICON_FA_FILE_IMPORT",
            words=(*_WORDS, "OpenSCENARIO", "xosc", "json", "import"),
            needs="Select something that drives, or a parked thing",
            undoable=True,
        ),
        Action(
            "way.panel",
            "Show the speed along the way",
            put_request(session, ShowPanel("Way")),
            "Move",
            ("Alt+W",),
            enabled=lambda: session.document is not None,
            icon="ICON_FA_GAUGE_HIGH",
            words=(*_WORDS, "graph", "retime"),
        ),
    ]
