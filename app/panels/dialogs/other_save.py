"""Asking before a project is written over that another editor has saved since."""

from __future__ import annotations

from imgui_bundle import imgui

from instdrive_app.panels.dialogs.questions import draw_question
from instdrive_app.panels.widgets.ui import Ui

TITLE = "Saved by another editor"


class OtherSaveDialog:
    """Opens itself when `files.other_save` is set."""

    names: tuple[str, ...] = ()

    def ask(self, ui: Ui, name: str) -> None:
        """Never by name."""

    def draw(self, ui: Ui) -> None:
        """One frame."""
        files = ui.session.files
        other = files.other_save
        if other is None:
            return
        if not imgui.is_popup_open(TITLE):
            imgui.open_popup(TITLE)

        def save_over() -> None:
            files.other_save = None
            other.save_over()

        def leave() -> None:
            files.other_save = None

        text = (
            f"{other.path.name} was saved by another editor since it was opened here. Saved over, what was done there "
            "is lost.\n\nFile, Save project as… keeps both."
        )
        draw_question(ui, TITLE, text, {"Cancel": leave, "Save over it": save_over})
