"""Changing the selection."""

from __future__ import annotations

from instdrive_app.commands import Command
from instdrive_app.session import EditorSession


def commands(session: EditorSession) -> list[Command]:
    """The Select menu."""
    return [
        Command(
            "select.codeword",
            "Extend to the whole codeword",
            lambda: session.select_codeword_of(session.selected[0]),
            "Select",
            ("G",),
            enabled=lambda: len(session.selected) == 1 and session.has_codewords,
            icon="ICON_FA_BARCODE",
        ),
        Command(
            "select.none",
            "Select nothing",
            session.clear_selection,
            "Select",
            ("Escape",),
            enabled=lambda: bool(session.selected),
            icon="ICON_FA_BAN",
        ),
    ]
