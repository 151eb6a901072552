"""What can be done to where the selection is, and what moves are bound to. The tools themselves are in `tools`."""

from __future__ import annotations

from collections.abc import Callable

from instdrive_app.action import Action
from instdrive_app.actions.conditions import is_editable, put_request
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.session.move_controller import MoveOptions
from instdrive_app.session.requests import AskUp

SWITCHES = ("move.on_ground", "move.yaw_only", "move.along_lane")
"""Commands that bind moves."""


def list_actions(session: EditorSession) -> list[Action]:
    """The Move menu."""
    return [*_list_moves(session), *_list_constraints(session)]


def _list_moves(session: EditorSession) -> list[Action]:
    moving = session.movement

    def selected() -> bool:
        return bool(session.selection.ids)

    return [
        Action(
            "move.duplicate",
            "Duplicate",
            moving.duplicate,
            "Move",
            ("Ctrl+D",),
            enabled=selected,
            icon="ICON_FA_CLONE",
            undoable=True,
        ),
        Action(
            "move.put_on_ground",
            "Put on the ground",
            moving.put_on_ground,
            "Move",
            ("Ctrl+G",),
            enabled=selected,
            icon="ICON_FA_ARROWS_DOWN_TO_LINE",
            undoable=True,
        ),
        Action(
            "move.reset",
            "Reset the move",
            moving.reset,
            "Move",
            enabled=selected,
            icon="ICON_FA_ARROW_ROTATE_LEFT",
            undoable=True,
        ),
        Action(
            "move.turn_upright",
            "Turn upright…",
            put_request(session, AskUp()),
            "Move",
            enabled=lambda: is_editable(session),
            icon="ICON_FA_ARROWS_SPIN",
            separator=True,
            undoable=True,
        ),
    ]


def _list_constraints(session: EditorSession) -> list[Action]:
    """What moves are bound to."""
    moving = session.movement
    return [
        Action(
            "move.on_ground",
            "Moves stay on the ground",
            _toggle_option(moving.options, "on_ground"),
            "Move",
            checked=lambda: moving.options.on_ground,
            icon="ICON_FA_MAGNET",
            separator=True,
        ),
        Action(
            "move.yaw_only",
            "Turn about the vertical only",
            _toggle_yaw_only(session),
            "Move",
            checked=lambda: moving.yaw_only,
            icon="ICON_FA_COMPASS",
        ),
        Action(
            "move.along_lane",
            "Move along the lane",
            _toggle_option(moving.options, "along_lane"),
            "Move",
            checked=lambda: moving.options.along_lane,
            icon="ICON_FA_ROAD",
        ),
    ]


def _toggle_option(options: MoveOptions, name: str) -> Callable[[], None]:
    def run() -> None:
        setattr(options, name, not getattr(options, name))

    return run


def _toggle_yaw_only(session: EditorSession) -> Callable[[], None]:
    def run() -> None:
        session.movement.options.yaw_only = not session.movement.yaw_only

    return run
