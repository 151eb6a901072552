"""The question that is asked when a project's scene file has changed since it was edited."""

from __future__ import annotations

from imgui_bundle import imgui

from instdrive_app.language.translation import make_label
from instdrive_app.panels.dialogs.questions import draw_question
from instdrive_app.panels.widgets.ui import Ui
from instdrive_app.session.requests import AskChangedScene
from instdrive_core.wording import phrase

TITLE = "The scene has changed"


class ChangedSceneDialog:
    """Opens the document anyway, or leaves it closed."""

    def __init__(self) -> None:
        self._request: AskChangedScene | None = None
        """The request, until the user has answered it."""

    def open(self, ui: Ui, request: AskChangedScene) -> None:
        """Open it."""
        self._request = request
        imgui.open_popup(make_label(TITLE))

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        request = self._request
        if request is None:
            return

        def open_anyway() -> None:
            self._request = None
            request.open_anyway()

        def cancel() -> None:
            self._request = None

        then = "If you open it anyway, the edits that still fit are applied to the scene as it is now."
        text = phrase("{reason}\n\n{then}", reason=phrase(request.reason), then=phrase(then))
        draw_question(ui, TITLE, text, {"Cancel": cancel, "Open anyway": open_anyway})
