"""Cleaning up after a deletion."""

from __future__ import annotations

from instdrive_app.action import Action
from instdrive_app.actions.conditions import is_editable
from instdrive_app.session.editor_session import EditorSession


def list_actions(session: EditorSession) -> list[Action]:
    """List the ends of the Edit and View menus."""
    review = session.deletion.review

    def has_residue() -> bool:
        found = review.findings
        return is_editable(session) and found is not None and found.residue_count > 0

    def has_hole() -> bool:
        found = review.findings
        return is_editable(session) and found is not None and bool(found.holes) and not review.is_filling

    return [
        Action(
            "deletion.absorb",
            "Delete the residue of the deletion",
            review.absorb,
            "Edit",
            enabled=has_residue,
            icon="ICON_FA_BROOM",
            words=("clean", "noise"),
            needs="No deletion has left residue",
            separator=True,
            undoable=True,
        ),
        Action(
            "deletion.fill",
            "Fill the hole of the deletion",
            review.fill,
            "Edit",
            enabled=has_hole,
            icon="ICON_FA_FILL_DRIP",
            words=("inpaint", "repair"),
            needs="There is no hole to fill",
            undoable=True,
        ),
        Action(
            "deletion.fill_all",
            "Fill all holes",
            review.fill_all,
            "Edit",
            enabled=has_hole,
            icon="ICON_FA_FILL_DRIP",
            needs="There is no hole to fill",
            undoable=True,
        ),
        Action(
            "deletion.clear",
            "Dismiss the deletion report",
            review.clear,
            "View",
            enabled=lambda: review.findings is not None,
            icon="ICON_FA_XMARK",
            needs="There is no report to dismiss",
        ),
    ]
