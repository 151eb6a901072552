"""Asking whether a project, or a dead editor's work, is opened though its scene is no longer the one edited."""

from __future__ import annotations

from imgui_bundle import imgui

from instdrive_app.panels.dialogs.questions import draw_question
from instdrive_app.panels.widgets.ui import Ui

TITLE = "The scene has changed"


class ChangedSceneDialog:
    """Opens itself when `files.changed_scene` is set."""

    names: tuple[str, ...] = ()

    def ask(self, ui: Ui, name: str) -> None:
        """Never by name."""

    def draw(self, ui: Ui) -> None:
        """One frame."""
        files = ui.session.files
        changed = files.changed_scene
        if changed is None:
            return
        if not imgui.is_popup_open(TITLE):
            imgui.open_popup(TITLE)

        def open_anyway() -> None:
            files.changed_scene = None
            changed.open_anyway()

        def leave() -> None:
            files.changed_scene = None

        then = "Opened anyway, the edits are done on the scene as it is now, without those that do not fit."
        draw_question(ui, TITLE, f"{changed.said}\n\n{then}", {"Cancel": leave, "Open anyway": open_anyway})
