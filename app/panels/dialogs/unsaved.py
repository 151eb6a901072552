"""Asking before unsaved changes are lost."""

from __future__ import annotations

from imgui_bundle import imgui

from instdrive_app.panels.dialogs.questions import draw_question
from instdrive_app.panels.widgets.ui import Ui

TITLE = "Unsaved changes"


class UnsavedDialog:
    """Save, do not save, or stay; then `session.waiting` goes on."""

    names: tuple[str, ...] = ("unsaved",)

    def ask(self, ui: Ui, name: str) -> None:
        """Open it."""
        imgui.open_popup(TITLE)

    def draw(self, ui: Ui) -> None:
        """One frame."""
        session = ui.session
        path, project = session.files.path, session.files.project
        where = "not saved" if project else "in no project file"
        text = f"The changes to {path.name if path else 'the scene'} are {where} yet."

        def save() -> None:
            if session.files.project is None:
                session.dialog = "save"  # which goes on with what is waiting
            else:
                then, session.waiting = session.waiting, None
                session.save(then=then or (lambda: None))

        def discard() -> None:
            then, session.waiting = session.waiting, None
            if then is not None:
                then()

        def stay() -> None:
            session.waiting = None

        draw_question(ui, TITLE, text, {"Cancel": stay, "Don't save": discard, "Save": save})
