"""The question before a project is overwritten that another editor has saved in the meantime."""

from __future__ import annotations

from imgui_bundle import imgui

from instdrive_app.language.translation import make_label
from instdrive_app.panels.dialogs.questions import draw_question
from instdrive_app.panels.widgets.ui import Ui
from instdrive_app.session.requests import AskOtherSave
from instdrive_core.wording import phrase

TITLE = "Saved by another editor"


class OtherSaveDialog:
    """Overwrites the project, or leaves it as it is."""

    def __init__(self) -> None:
        self._request: AskOtherSave | None = None
        """The request, until the user has answered it."""

    def open(self, ui: Ui, request: AskOtherSave) -> None:
        """Open it."""
        self._request = request
        imgui.open_popup(make_label(TITLE))

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        request = self._request
        if request is None:
            return

        def save_over() -> None:
            self._request = None
            request.save_over()

        def cancel() -> None:
            self._request = None

        text = phrase(
            "Another editor has saved {name} since you opened it here. If you overwrite it, the "
            "changes made there are lost.\n\nFile › Save project as… keeps both.",
            name=request.path.name,
        )
        draw_question(ui, TITLE, text, {"Cancel": cancel, "Overwrite": save_over})
