"""Asking whether a project is opened though its scene is no longer the one that was edited."""

from __future__ import annotations

from imgui_bundle import imgui

from instdrive_app.panels.dialogs.questions import question
from instdrive_app.panels.ui import Ui

TITLE = "The scene has changed"


class ChangedSceneDialog:
    """Opens itself when `files.changed_project` is set."""

    names: tuple[str, ...] = ()

    def ask(self, ui: Ui, name: str) -> None:
        """Never by name."""

    def draw(self, ui: Ui) -> None:
        """One frame."""
        files = ui.session.files
        if files.changed_project is None:
            return
        path, said = files.changed_project
        if not imgui.is_popup_open(TITLE):
            imgui.open_popup(TITLE)

        def open_anyway() -> None:
            files.changed_project = None
            files.open(path, accept_changed=True)

        def leave() -> None:
            files.changed_project = None

        text = f"{said}\n\nOpened anyway, the edits are done on the scene as it is now, without those that do not fit."
        question(ui, TITLE, text, {"Cancel": leave, "Open anyway": open_anyway})
