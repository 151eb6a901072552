"""Offers to open only some splats of a scene that does not fit into memory."""

from __future__ import annotations

from imgui_bundle import imgui

from instdrive_app.panels.dialogs.questions import draw_question
from instdrive_app.panels.widgets.ui import Ui
from instdrive_app.session.requests import AskTooLarge
from instdrive_core.errors import format_gigabytes, format_ordinal

TITLE = "The scene is too large"


class TooLargeDialog:
    """Opens every k-th splat of the scene, or nothing."""

    def __init__(self) -> None:
        self._request: AskTooLarge | None = None
        """The request, until the user has answered it."""

    def open(self, ui: Ui, request: AskTooLarge) -> None:
        """Open it."""
        self._request = request
        imgui.open_popup(TITLE)

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        if self._request is None:
            return
        path, found = self._request.path, self._request.error
        keep_every = found.keep_every or found.count
        every = f"every {format_ordinal(keep_every)}"

        def open_part() -> None:
            self._request = None
            ui.session.files.open(path, keep_every=keep_every)

        def cancel() -> None:
            self._request = None

        text = (
            f"{path.name} has {found.count:,} splats. Editing it needs {format_gigabytes(found.needed)} of memory; "
            f"{format_gigabytes(found.available)} are free. Open {every} splat?\n\n"
            "The splats are then made larger, so that they leave no gaps. The file does not change."
        )
        draw_question(ui, TITLE, text, {"Cancel": cancel, f"Open {every}": open_part})
