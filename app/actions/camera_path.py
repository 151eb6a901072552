"""The camera's path: keys, preview and film."""

from __future__ import annotations

from instdrive_app.action import Action
from instdrive_app.actions.conditions import is_editable, put_request
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.session.requests import AskExport, ShowPanel

_WORDS = ("film", "video", "movie", "animation", "fly through", "keyframe", "camera path")


def list_actions(session: EditorSession) -> list[Action]:
    """List the part of the Time menu about the camera's path."""
    path = session.camera_path

    def add() -> None:
        path.add()
        session.requests.put(ShowPanel("Camera path"))

    def has_path() -> bool:
        return session.document is not None and len(path.keys) > 1

    def has_chosen() -> bool:
        return session.document is not None and path.chosen is not None

    return [
        Action(
            "path.play",
            "Play the camera path",
            path.toggle_playing,
            "Time",
            ("Shift+Space",),
            enabled=has_path,
            checked=lambda: path.playing,
            icon="ICON_FA_CIRCLE_PLAY",
            words=_WORDS,
            needs="Add two keys to the camera path first (Shift+K)",
            separator=True,
        ),
        Action(
            "path.add",
            "Add this view to the camera path",
            add,
            "Time",
            ("Shift+K",),
            enabled=lambda: session.document is not None,
            icon="ICON_FA_PLUS",
            words=_WORDS,
            undoable=True,
        ),
        Action(
            "path.replace",
            "Set the chosen key to this view",
            path.replace,
            "Time",
            enabled=has_chosen,
            icon="ICON_FA_ARROWS_ROTATE",
            words=_WORDS,
            needs="Click a key in the Camera path panel first",
            undoable=True,
        ),
        Action(
            "path.delete",
            "Delete the chosen key",
            path.delete,
            "Time",
            enabled=has_chosen,
            icon="ICON_FA_TRASH",
            words=_WORDS,
            needs="Click a key in the Camera path panel first",
            undoable=True,
        ),
        Action(
            "path.film",
            "Save the film…",
            put_request(session, AskExport("film")),
            "Time",
            ("Alt+F12",),
            enabled=lambda: is_editable(session) and has_path(),
            icon="ICON_FA_CLAPPERBOARD",
            words=(*_WORDS, "mp4", "webm", "png sequence", "render"),
            needs="Add two keys to the camera path first (Shift+K)",
            undoable=False,
        ),
    ]
