"""Undo, redo, and what is done to the selected instances."""

from __future__ import annotations

from instdrive_app.action import Action
from instdrive_app.actions.conditions import asking, is_editable
from instdrive_app.session.editor_session import EditorSession


def list_actions(session: EditorSession) -> list[Action]:
    """The Edit menu."""
    return [*_history(session), *_changes(session), *_showing(session), *_odd_splats(session)]


def _history(session: EditorSession) -> list[Action]:
    def reaches(back: bool) -> bool:
        if session.document is None:
            return False
        history = session.document.history
        return history.cursor > 0 if back else history.cursor < len(history.edits)

    return [
        Action(
            "edit.undo",
            "Undo",
            session.undo,
            "Edit",
            ("Ctrl+Z",),
            enabled=lambda: reaches(back=True),
            icon="ICON_FA_ROTATE_LEFT",
        ),
        Action(
            "edit.redo",
            "Redo",
            session.redo,
            "Edit",
            ("Ctrl+Shift+Z", "Ctrl+Y"),
            enabled=lambda: reaches(back=False),
            icon="ICON_FA_ROTATE_RIGHT",
        ),
    ]


def _changes(session: EditorSession) -> list[Action]:
    return [
        Action(
            "edit.delete",
            "Delete",
            session.delete_selection,
            "Edit",
            ("Delete",),
            enabled=lambda: session.has_selection,
            icon="ICON_FA_TRASH",
            undoable=True,
            separator=True,
        ),
        Action(
            "edit.recolor",
            "Recolour",
            lambda: session.recolor(session.selected, session.recolor_mode, session.recolor_color),
            "Edit",
            ("C",),
            enabled=lambda: bool(session.selected),
            icon="ICON_FA_PAINTBRUSH",
            undoable=True,
        ),
        Action(
            "edit.reset_colors",
            "Reset colours",
            lambda: session.reset_colors(session.selected),
            "Edit",
            ("Shift+C",),
            enabled=lambda: bool(session.selected),
            icon="ICON_FA_ARROW_ROTATE_LEFT",
            undoable=True,
        ),
        Action(
            "edit.rename",
            "Rename…",
            lambda: session.ask_name(session.selected[0]),
            "Edit",
            ("F2",),
            enabled=lambda: len(session.selected) == 1,
            icon="ICON_FA_PEN",
            undoable=True,
        ),
    ]


def _showing(session: EditorSession) -> list[Action]:
    """What is shown, and what may be edited."""
    return [
        Action(
            "edit.hide",
            "Hide",
            lambda: session.hide(session.selected),
            "Edit",
            ("H",),
            enabled=lambda: bool(session.selected),
            icon="ICON_FA_EYE_SLASH",
            undoable=True,
            separator=True,
        ),
        Action(
            "edit.lock",
            "Lock",
            lambda: session.lock(session.selected),
            "Edit",
            ("Ctrl+L",),
            enabled=lambda: bool(session.selected),
            icon="ICON_FA_LOCK",
            undoable=True,
        ),
        Action(
            "edit.unlock_all",
            "Unlock all",
            lambda: session.lock(session.locked, locked=False),
            "Edit",
            ("Ctrl+Shift+L",),
            enabled=lambda: bool(session.locked),
            icon="ICON_FA_LOCK_OPEN",
            undoable=True,
        ),
        Action(
            "edit.solo",
            "Show only the selection",
            lambda: session.solo.toggle(session.selected or session.solo.ids),
            "Edit",
            ("I",),
            enabled=lambda: bool(session.selected or session.solo.ids),
            checked=lambda: bool(session.solo.ids),
            icon="ICON_FA_BULLSEYE",
            undoable=True,
        ),
        Action(
            "edit.show_all",
            "Show all",
            session.show_all,
            "Edit",
            ("Alt+H",),
            enabled=lambda: is_editable(session),
            icon="ICON_FA_EYE",
            undoable=True,
        ),
    ]


def _odd_splats(session: EditorSession) -> list[Action]:
    return [
        Action(
            "edit.odd_splats",
            "Odd splats…",
            asking(session, "findings"),
            "Edit",
            enabled=lambda: is_editable(session) and bool(session.findings),
            icon="ICON_FA_BROOM",
            separator=True,
            undoable=True,
        ),
    ]
