"""Changing the selection."""

from __future__ import annotations

from instdrive_app.action import Action
from instdrive_app.actions.conditions import is_editable, put_request
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.session.requests import ShowPanel
from instdrive_core.edits.kinds.compound import CompoundEdit
from instdrive_core.edits.kinds.select import InvertSelection, SelectAll, SelectClass
from instdrive_core.wording import phrase


def list_actions(session: EditorSession) -> list[Action]:
    """List the Select menu."""
    return [*_list_sets(session), *_list_filters(session), *_list_borders(session), *_list_kinds(session)]


def _list_sets(session: EditorSession) -> list[Action]:
    return [
        Action(
            "select.all",
            "Select all",
            lambda: session.history.apply(SelectAll),
            "Select",
            ("Ctrl+A",),
            enabled=lambda: is_editable(session),
            icon="ICON_FA_OBJECT_GROUP",
            undoable=True,
        ),
        Action(
            "select.none",
            "Select nothing",
            session.selection.clear,
            "Select",
            ("Escape",),
            enabled=lambda: not session.selection.is_empty,
            icon="ICON_FA_BAN",
            undoable=True,
        ),
        Action(
            "select.invert",
            "Invert the selection",
            lambda: session.history.apply(InvertSelection),
            "Select",
            ("Ctrl+I",),
            enabled=lambda: is_editable(session),
            icon="ICON_FA_CIRCLE_HALF_STROKE",
            words=("crop",),
            undoable=True,
        ),
    ]


def _list_filters(session: EditorSession) -> list[Action]:
    return [
        Action(
            "select.by_value",
            "Select by value…",
            put_request(session, ShowPanel("Filter")),
            "Select",
            ("Ctrl+F",),
            enabled=lambda: is_editable(session),
            icon="ICON_FA_FILTER",
            words=("histogram", "range", "opacity", "size", "distance", "colour", "color", "filter", "column"),
            undoable=True,
            separator=True,
        ),
        Action(
            "select.floaters",
            "Select floaters of the whole scene",
            session.filter.select_floaters,
            "Select",
            ("Ctrl+Shift+F",),
            enabled=lambda: is_editable(session),
            icon="ICON_FA_WAND_MAGIC_SPARKLES",
            words=("clean", "isolated", "thin", "faint", "needle", "outlier", "filter", "noise"),
            undoable=True,
        ),
    ]


def _list_borders(session: EditorSession) -> list[Action]:
    return [
        Action(
            "select.grow",
            "Grow the selection",
            session.selection.border.grow,
            "Select",
            ("Ctrl+=",),
            enabled=lambda: not session.selection.is_empty,
            icon="ICON_FA_UP_RIGHT_AND_DOWN_LEFT_FROM_CENTER",
            undoable=True,
            separator=True,
        ),
        Action(
            "select.shrink",
            "Shrink the selection",
            session.selection.border.shrink,
            "Select",
            ("Ctrl+-",),
            enabled=lambda: not session.selection.is_empty,
            icon="ICON_FA_DOWN_LEFT_AND_UP_RIGHT_TO_CENTER",
            undoable=True,
        ),
    ]


def _list_kinds(session: EditorSession) -> list[Action]:
    return [
        Action(
            "select.class",
            "Extend to the whole class",
            lambda: _select_classes(session),
            "Select",
            ("K",),
            enabled=lambda: bool(_find_classes(session)),
            icon="ICON_FA_TAGS",
            needs="Select instances that have a class",
            undoable=True,
            separator=True,
        ),
        Action(
            "select.codeword",
            "Extend to the whole codeword",
            lambda: session.selection.select_codeword(session.selection.ids[0]),
            "Select",
            ("G",),
            enabled=lambda: len(session.selection.ids) == 1 and session.selection.has_codewords,
            icon="ICON_FA_BARCODE",
            needs="Select one instance of a scene with codewords",
            undoable=True,
        ),
    ]


def _find_classes(session: EditorSession) -> tuple[str, ...]:
    """Find the classes of the selected instances, sorted."""
    if session.document is None:
        return ()
    table = session.document.scene.table
    return tuple(sorted({table[instance].class_name for instance in session.selection.ids} - {""}))


def _select_classes(session: EditorSession) -> None:
    classes = _find_classes(session)
    edits = tuple(SelectClass(name, "add") for name in classes)
    if len(edits) == 1:
        session.history.apply(edits[0])
    else:
        session.history.apply(CompoundEdit(edits, phrase("Select classes {names}", names=", ".join(classes))))
