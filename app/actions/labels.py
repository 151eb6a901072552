"""Repairing labels: which instance splats belong to, and which class instances have."""

from __future__ import annotations

from instdrive_app.action import Action
from instdrive_app.actions.conditions import is_editable, put_request, run_on_instances
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.session.requests import AskClass, AskFindObjects, AskReassign, AskSplit


def list_actions(session: EditorSession) -> list[Action]:
    """List the Labels menu."""
    return [*_list_instance_actions(session), *_list_splat_actions(session)]


def _list_instance_actions(session: EditorSession) -> list[Action]:
    def has_instances(count: int = 1) -> bool:
        return is_editable(session) and len(session.selection.ids) >= count

    def has_splats() -> bool:
        return is_editable(session) and not session.selection.is_empty

    def has_one_instance() -> bool:
        return is_editable(session) and len(session.selection.ids) == 1

    return [
        Action(
            "labels.class",
            "Set class…",
            run_on_instances(session, lambda: session.requests.put(AskClass(session.selection.ids))),
            "Labels",
            ("Ctrl+T",),
            enabled=has_splats,
            icon="ICON_FA_TAG",
            undoable=True,
        ),
        Action(
            "labels.merge",
            "Merge",
            lambda: session.labels.merge(session.selection.ids),
            "Labels",
            ("Ctrl+M",),
            enabled=lambda: has_instances(2),
            icon="ICON_FA_OBJECT_GROUP",
            needs="Select two or more instances",
            separator=True,
            undoable=True,
        ),
        Action(
            "labels.split",
            "Split by component…",
            lambda: session.requests.put(AskSplit(session.selection.ids[0])),
            "Labels",
            ("Ctrl+J",),
            enabled=has_one_instance,
            icon="ICON_FA_OBJECT_UNGROUP",
            needs="Select one instance",
            undoable=True,
        ),
    ]


def _list_splat_actions(session: EditorSession) -> list[Action]:
    def has_splats() -> bool:
        return is_editable(session) and not session.selection.is_empty

    return [
        Action(
            "labels.reassign",
            "Reassign the selected splats…",
            put_request(session, AskReassign()),
            "Labels",
            ("Ctrl+R",),
            enabled=has_splats,
            icon="ICON_FA_RIGHT_LEFT",
            needs="Select splats with the rectangle or the lasso",
            undoable=True,
        ),
        Action(
            "labels.new",
            "New instance from the selected splats",
            lambda: session.labels.reassign(None),
            "Labels",
            ("Ctrl+Shift+N",),
            enabled=has_splats,
            icon="ICON_FA_CIRCLE_PLUS",
            needs="Select splats with the rectangle or the lasso",
            undoable=True,
        ),
        Action(
            "labels.absorb",
            "Absorb floaters",
            lambda: session.labels.absorb(session.selection.ids),
            "Labels",
            ("Ctrl+B",),
            enabled=lambda: is_editable(session) and bool(session.selection.ids),
            icon="ICON_FA_BROOM",
            undoable=True,
        ),
        Action(
            "labels.find_objects",
            "Find objects…",
            put_request(session, AskFindObjects()),
            "Labels",
            enabled=lambda: is_editable(session),
            icon="ICON_FA_CUBES",
            words=("instances", "segment", "detect", "cars", "no instances", "masks", "photos", "segmentation"),
            separator=True,
            undoable=True,
        ),
    ]
