"""The question before unsaved changes are lost."""

from __future__ import annotations

from imgui_bundle import imgui

from instdrive_app.language.translation import make_label
from instdrive_app.panels.dialogs.questions import draw_question
from instdrive_app.panels.widgets.ui import Ui
from instdrive_app.session.requests import AskPath, AskUnsaved
from instdrive_core.wording import phrase

TITLE = "Unsaved changes"


class UnsavedDialog:
    """Offers to save, not to save, or to stay; unless the user stays, what the request waits with follows."""

    def __init__(self) -> None:
        self._request: AskUnsaved | None = None
        """The request, until the user has answered it."""

    def open(self, ui: Ui, request: AskUnsaved) -> None:
        """Open it."""
        self._request = request
        imgui.open_popup(make_label(TITLE))

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        request, files = self._request, ui.session.files
        if request is None:
            return
        path, project = files.path, files.project
        name = path.name if path else phrase("the scene")
        text = phrase("The changes to {name} have not been saved to a project file.", name=name)
        if project:
            text = phrase("The changes to {name} have not been saved.", name=name)

        def save() -> None:
            self._request = None
            if files.project is None:
                ui.session.requests.put(AskPath("save", request.then))
            else:
                files.save(then=request.then)

        def discard() -> None:
            self._request = None
            request.then()

        def stay() -> None:
            self._request = None

        draw_question(ui, TITLE, text, {"Cancel": stay, "Don't save": discard, "Save": save})
