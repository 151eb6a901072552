"""Moving the selection, and constraints of moves. The move tools themselves are in `tools`."""

from __future__ import annotations

from collections.abc import Callable

from instdrive_app.action import Action
from instdrive_app.actions.conditions import is_editable, put_request, run_on_instances
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.session.move_controller import MoveOptions
from instdrive_app.session.requests import AskUp
from instdrive_core.edits.kinds.driving.ways import Template

LANE = 3.5
"""Metres to the next lane."""
SWITCHES = ("move.on_ground", "move.yaw_only", "move.along_lane", "move.lay_shadows")
"""IDs of the actions that constrain moves."""


def list_actions(session: EditorSession) -> list[Action]:
    """List the Move menu."""
    return [*_list_moves(session), *_list_ways(session), *_list_constraints(session)]


def _list_moves(session: EditorSession) -> list[Action]:
    movement = session.movement

    def has_selection() -> bool:
        return not session.selection.is_empty

    return [
        Action(
            "move.duplicate",
            "Duplicate",
            run_on_instances(session, movement.duplicate),
            "Move",
            ("Ctrl+D",),
            enabled=has_selection,
            icon="ICON_FA_CLONE",
            undoable=True,
        ),
        Action(
            "move.put_on_ground",
            "Put on the ground",
            run_on_instances(session, movement.put_on_ground),
            "Move",
            ("Ctrl+G",),
            enabled=has_selection,
            icon="ICON_FA_ARROWS_DOWN_TO_LINE",
            undoable=True,
        ),
        Action(
            "move.reset",
            "Reset the move",
            movement.reset,
            "Move",
            enabled=lambda: bool(session.selection.ids),
            icon="ICON_FA_ARROW_ROTATE_LEFT",
            undoable=True,
        ),
        Action(
            "move.add_shadow",
            "Lay a shadow",
            run_on_instances(session, lambda: session.shadows.add(session.selection.ids)),
            "Move",
            enabled=has_selection,
            icon="ICON_FA_CLOUD_SUN",
            words=("shade", "sun", "light", "ground", "dark"),
            separator=True,
            undoable=True,
        ),
        Action(
            "move.remove_shadow",
            "Remove the laid shadow",
            lambda: session.shadows.remove(session.selection.ids),
            "Move",
            enabled=lambda: session.shadows.has_shadow(session.selection.ids),
            icon="ICON_FA_SUN",
            words=("shade", "sun", "light"),
            needs="Select something below which a shadow was laid",
            undoable=True,
        ),
        Action(
            "move.turn_upright",
            "Turn upright…",
            put_request(session, AskUp()),
            "Move",
            enabled=lambda: is_editable(session),
            icon="ICON_FA_ARROWS_SPIN",
            words=("rotate scene", "up", "orient", "flip"),
            separator=True,
            undoable=True,
        ),
    ]


def _list_ways(session: EditorSession) -> list[Action]:
    """List what changes the ways of things that drive, from the shown time on."""
    movement = session.movement

    def make(name: str, title: str, icon: str, run: Callable[[], None], separator: bool = False) -> Action:
        return Action(
            f"move.{name}",
            title,
            run,
            "Move",
            enabled=lambda: movement.has_drive,
            icon=icon,
            words=("path", "track", "way", "drive", "vehicle", "trajectory"),
            separator=separator,
            undoable=True,
        )

    def change(template: Template, amount: float = 0.0) -> Callable[[], None]:
        return lambda: movement.change_ways(template, amount)

    return [
        make("park", "Park where it is now", "ICON_FA_SQUARE_PARKING", movement.park, separator=True),
        make("stop", "Brake to a stop from now on", "ICON_FA_HAND", change("stop")),
        make("wait", "Wait here for 2 s from now on", "ICON_FA_HOURGLASS_HALF", change("wait", 2.0)),
        make("start", "Stand until now, then drive", "ICON_FA_FLAG_CHECKERED", change("start")),
        make("slow", "Drive half as fast from now on", "ICON_FA_GAUGE", change("speed", 0.5)),
        make("lane_left", "Change lane to the left", "ICON_FA_ARROW_LEFT", change("lane", LANE)),
        make("lane_right", "Change lane to the right", "ICON_FA_ARROW_RIGHT", change("lane", -LANE)),
        make("turn_left", "Turn off to the left", "ICON_FA_ARROW_TURN_UP", change("turn", 90.0)),
        make("turn_right", "Turn off to the right", "ICON_FA_ARROW_TURN_DOWN", change("turn", -90.0)),
    ]


def _list_constraints(session: EditorSession) -> list[Action]:
    """List the constraints of moves, and what follows them."""
    movement = session.movement

    return [
        Action(
            "move.on_ground",
            "Keep on the ground when moving",
            _toggle_option(movement.options, "on_ground"),
            "Move",
            checked=lambda: movement.options.on_ground,
            icon="ICON_FA_MAGNET",
            separator=True,
        ),
        Action(
            "move.yaw_only",
            "Rotate about the vertical only",
            _toggle_yaw_only(session),
            "Move",
            checked=lambda: movement.yaw_only,
            icon="ICON_FA_COMPASS",
        ),
        Action(
            "move.body_only",
            "Turn the body only, not its drive",
            _toggle_option(movement.options, "body_only"),
            "Move",
            checked=lambda: movement.options.body_only,
            enabled=lambda: movement.has_drive,
            icon="ICON_FA_CAR_SIDE",
            words=("rotate", "track", "path", "drive"),
            needs="Select something that drives",
        ),
        Action(
            "move.along_lane",
            "Move along the lane",
            _toggle_option(movement.options, "along_lane"),
            "Move",
            checked=lambda: movement.options.along_lane,
            icon="ICON_FA_ROAD",
        ),
        Action(
            "move.lay_shadows",
            "Give moved and added things a shadow",
            _toggle_option(movement.options, "lays_shadows"),
            "Move",
            checked=lambda: movement.options.lays_shadows,
            icon="ICON_FA_CLOUD_SUN",
            words=("shade", "sun", "light", "contact"),
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
