"""Cleaning up after a deletion."""

from __future__ import annotations

from instdrive_app.action import Action
from instdrive_app.actions.conditions import is_editable
from instdrive_app.session.editor_session import EditorSession


def list_actions(session: EditorSession) -> list[Action]:
    """At the end of the Edit and View menus."""

    def residue() -> bool:
        found = session.aftermath.findings
        return is_editable(session) and found is not None and found.residue_count > 0

    def hole() -> bool:
        found = session.aftermath.findings
        return (
            is_editable(session) and found is not None and found.hole is not None and not session.aftermath.is_filling
        )

    return [
        Action(
            "aftermath.absorb",
            "Absorb floaters of the deletion",
            session.aftermath.absorb,
            "Edit",
            enabled=residue,
            icon="ICON_FA_BROOM",
            separator=True,
            undoable=True,
        ),
        Action(
            "aftermath.fill",
            "Fill hole",
            session.aftermath.fill,
            "Edit",
            enabled=hole,
            icon="ICON_FA_FILL_DRIP",
            undoable=True,
        ),
        Action(
            "aftermath.clear",
            "Clear report of the deletion",
            session.aftermath.clear,
            "View",
            enabled=lambda: session.aftermath.findings is not None,
            icon="ICON_FA_XMARK",
        ),
    ]
