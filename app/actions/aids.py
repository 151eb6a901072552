"""What the box does with what is inside or outside it, and taking the ruler away."""

from __future__ import annotations

from functools import partial

from instdrive_app.action import Action
from instdrive_app.actions.conditions import is_editable
from instdrive_app.session.editor_session import EditorSession
from instdrive_core.edits.kinds.select import SelectMode

TURN = 5.0
"""Degrees by which one command turns the box."""
_NO_BOX = "Place a box first (Z, then click)"
_WORDS = ("box", "crop", "volume", "inside", "outside")


def list_actions(session: EditorSession) -> list[Action]:
    """List the commands of the box and the ruler, at the end of the Tools menu."""
    return [*_list_selecting(session), *_list_cutting(session), *_list_shaping(session), _create_clear(session)]


def _has_box(session: EditorSession) -> bool:
    return is_editable(session) and session.aids.box.box is not None


def _list_selecting(session: EditorSession) -> list[Action]:
    box = session.aids.box
    kinds: tuple[tuple[str, str, str, str, SelectMode], ...] = (
        ("box.select", "Select what is in the box", "Enter", "ICON_FA_CUBE", "replace"),
        ("box.add", "Add what is in the box to the selection", "Shift+Enter", "ICON_FA_PLUS", "add"),
        ("box.deselect", "Deselect what is in the box", "Ctrl+Enter", "ICON_FA_MINUS", "remove"),
    )
    return [
        Action(
            name,
            title,
            partial(box.select, mode),
            "Tools",
            (key,),
            enabled=lambda: _has_box(session),
            icon=icon,
            separator=mode == "replace",
            words=_WORDS,
            needs=_NO_BOX,
            undoable=True,
        )
        for name, title, key, icon, mode in kinds
    ]


def _list_cutting(session: EditorSession) -> list[Action]:
    box = session.aids.box
    return [
        Action(
            "box.select_outside",
            "Select what is outside the box",
            box.select_outside,
            "Tools",
            enabled=lambda: _has_box(session),
            icon="ICON_FA_CIRCLE_HALF_STROKE",
            words=_WORDS,
            needs=_NO_BOX,
            undoable=True,
        ),
        Action(
            "box.crop",
            "Show only what is in the box",
            box.toggle_crop,
            "Tools",
            ("Shift+Z",),
            enabled=lambda: is_editable(session) and (box.box is not None or box.is_cropping),
            checked=lambda: box.is_cropping,
            icon="ICON_FA_CROP_SIMPLE",
            words=(*_WORDS, "clip", "hide"),
            needs=_NO_BOX,
            undoable=True,
        ),
        Action(
            "box.delete_outside",
            "Delete what is outside the box",
            box.delete_outside,
            "Tools",
            enabled=lambda: _has_box(session),
            icon="ICON_FA_SCISSORS",
            words=(*_WORDS, "trim", "cut"),
            needs=_NO_BOX,
            undoable=True,
        ),
    ]


def _list_shaping(session: EditorSession) -> list[Action]:
    box = session.aids.box
    turns = (
        ("box.turn_left", "Turn the box left", "Shift+,", TURN, "ICON_FA_ROTATE_LEFT"),
        ("box.turn_right", "Turn the box right", "Shift+.", -TURN, "ICON_FA_ROTATE_RIGHT"),
    )
    return [
        *(
            Action(
                name,
                title,
                partial(box.turn, degrees),
                "Tools",
                (key,),
                enabled=lambda: _has_box(session),
                icon=icon,
                words=("box", "rotate"),
                needs=_NO_BOX,
            )
            for name, title, key, degrees, icon in turns
        ),
        Action(
            "box.remove",
            "Remove the box",
            box.remove,
            "Tools",
            ("Backspace",),
            enabled=lambda: _has_box(session),
            icon="ICON_FA_XMARK",
            words=_WORDS,
            needs=_NO_BOX,
        ),
    ]


def _create_clear(session: EditorSession) -> Action:
    return Action(
        "measure.clear",
        "Take the measurement away",
        session.aids.ruler.clear,
        "Tools",
        enabled=lambda: bool(session.aids.ruler.points),
        icon="ICON_FA_ERASER",
        words=("ruler", "measure", "distance"),
        needs="Measure something first (M, then two clicks)",
        separator=True,
    )
