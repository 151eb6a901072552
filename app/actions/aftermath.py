"""Cleaning up after a deletion."""

from __future__ import annotations

from instdrive_app.actions.conditions import editable
from instdrive_app.commands import Command
from instdrive_app.session.editor_session import EditorSession


def commands(session: EditorSession) -> list[Command]:
    """At the end of the Edit and View menus."""

    def residue() -> bool:
        found = session.aftermath.finding
        return editable(session) and found is not None and found.residue_count > 0

    def hole() -> bool:
        found = session.aftermath.finding
        return editable(session) and found is not None and found.hole is not None and not session.aftermath.filling

    return [
        Command(
            "aftermath.absorb",
            "Absorb floaters of the deletion",
            session.aftermath.absorb,
            "Edit",
            enabled=residue,
            icon="ICON_FA_BROOM",
            separator=True,
            undoable=True,
        ),
        Command(
            "aftermath.fill",
            "Fill hole",
            session.aftermath.fill,
            "Edit",
            enabled=hole,
            icon="ICON_FA_FILL_DRIP",
            undoable=True,
        ),
        Command(
            "aftermath.clear",
            "Clear report of the deletion",
            session.aftermath.clear,
            "View",
            enabled=lambda: session.aftermath.finding is not None,
            icon="ICON_FA_XMARK",
        ),
    ]
