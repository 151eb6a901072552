"""Undo, redo, and editing the selected instances."""

from __future__ import annotations

from instdrive_app.action import Action
from instdrive_app.actions.conditions import is_editable, put_request, run_on_instances
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.session.requests import AskName, AskPreferences, OfferCleanup, ShowPanel


def list_actions(session: EditorSession) -> list[Action]:
    """List the Edit menu."""
    return [
        *_list_history(session),
        *_list_changes(session),
        *_list_visibility(session),
        *_list_cleanup(session),
        _create_preferences(session),
    ]


def _create_preferences(session: EditorSession) -> Action:
    return Action(
        "edit.preferences",
        "Preferences…",
        put_request(session, AskPreferences()),
        "Edit",
        ("Ctrl+,",),
        icon="ICON_FA_GEAR",
        separator=True,
        words=("settings", "options", "theme", "dark", "light", "contrast", "colour blind", "keys", "language"),
    )


def _list_history(session: EditorSession) -> list[Action]:
    def can_step(back: bool) -> bool:
        if session.document is None:
            return False
        history, path = session.document.history, session.camera_path
        if back:
            return history.cursor > 0 or path.can_undo()
        return history.cursor < len(history.edits) or path.can_redo()

    return [
        Action(
            "edit.undo",
            "Undo",
            session.undo,
            "Edit",
            ("Ctrl+Z",),
            enabled=lambda: can_step(back=True),
            icon="ICON_FA_ROTATE_LEFT",
            needs="There is nothing to undo",
        ),
        Action(
            "edit.redo",
            "Redo",
            session.redo,
            "Edit",
            ("Ctrl+Shift+Z", "Ctrl+Y"),
            enabled=lambda: can_step(back=False),
            icon="ICON_FA_ROTATE_RIGHT",
            needs="There is nothing to redo",
        ),
    ]


def _list_changes(session: EditorSession) -> list[Action]:
    def ask_color() -> None:
        session.colors.ask_color()
        session.requests.put(ShowPanel("Inspector"))

    return [
        Action(
            "edit.delete",
            "Delete",
            session.deletion.delete_selection,
            "Edit",
            ("Delete",),
            enabled=lambda: not session.selection.is_empty,
            icon="ICON_FA_TRASH",
            words=("remove", "erase"),
            undoable=True,
            separator=True,
        ),
        Action(
            "edit.recolor",
            "Recolour…",
            run_on_instances(session, ask_color),
            "Edit",
            ("C",),
            enabled=lambda: not session.selection.is_empty,
            icon="ICON_FA_PAINTBRUSH",
            words=("paint", "color", "colour", "tint"),
            undoable=True,
        ),
        Action(
            "edit.reset_colors",
            "Reset colours",
            lambda: session.colors.reset(session.selection.ids),
            "Edit",
            ("Shift+C",),
            enabled=lambda: bool(session.selection.ids),
            icon="ICON_FA_ARROW_ROTATE_LEFT",
            undoable=True,
        ),
        Action(
            "edit.complete",
            "Complete by symmetry",
            run_on_instances(session, lambda: session.completion.complete(session.selection.ids)),
            "Edit",
            enabled=lambda: not session.selection.is_empty,
            icon="ICON_FA_CIRCLE_HALF_STROKE",
            words=("mirror", "far side", "unseen", "back", "repair"),
            undoable=True,
        ),
        Action(
            "edit.rename",
            "Rename…",
            run_on_instances(session, lambda: session.requests.put(AskName(session.selection.ids[0]))),
            "Edit",
            ("F2",),
            enabled=lambda: not session.selection.is_empty and len(session.selection.ids) <= 1,
            icon="ICON_FA_PEN",
            undoable=True,
        ),
    ]


def _list_visibility(session: EditorSession) -> list[Action]:
    """List what hides, shows and locks."""

    def toggle_solo() -> None:
        if session.selection.is_empty or session.selection.name_loose_splats():
            session.visibility.solo.toggle(session.selection.ids or session.visibility.solo.ids)

    return [
        Action(
            "edit.hide",
            "Hide",
            run_on_instances(session, lambda: session.visibility.hide(session.selection.ids)),
            "Edit",
            ("H",),
            enabled=lambda: not session.selection.is_empty,
            icon="ICON_FA_EYE_SLASH",
            undoable=True,
            separator=True,
        ),
        Action(
            "edit.lock",
            "Lock",
            run_on_instances(session, lambda: session.visibility.lock(session.selection.ids)),
            "Edit",
            ("Ctrl+L",),
            enabled=lambda: not session.selection.is_empty,
            icon="ICON_FA_LOCK",
            undoable=True,
        ),
        Action(
            "edit.unlock_all",
            "Unlock all",
            lambda: session.visibility.lock(session.visibility.locked_ids, locked=False),
            "Edit",
            ("Ctrl+Shift+L",),
            enabled=lambda: bool(session.visibility.locked_ids),
            icon="ICON_FA_LOCK_OPEN",
            undoable=True,
        ),
        Action(
            "edit.solo",
            "Show only the selection",
            toggle_solo,
            "Edit",
            ("I",),
            enabled=lambda: not session.selection.is_empty or bool(session.visibility.solo.ids),
            checked=lambda: bool(session.visibility.solo.ids),
            icon="ICON_FA_BULLSEYE",
            words=("crop", "isolate"),
            undoable=True,
        ),
        Action(
            "edit.show_all",
            "Show all",
            session.visibility.show_all,
            "Edit",
            ("Alt+H",),
            enabled=lambda: is_editable(session),
            icon="ICON_FA_EYE",
            undoable=True,
        ),
    ]


def _list_cleanup(session: EditorSession) -> list[Action]:
    return [
        Action(
            "edit.odd_splats",
            "Odd splats…",
            put_request(session, OfferCleanup()),
            "Edit",
            enabled=lambda: is_editable(session) and bool(session.files.defects),
            icon="ICON_FA_BROOM",
            needs="This scene has no odd splats",
            separator=True,
            undoable=True,
        ),
    ]
