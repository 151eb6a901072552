"""Offers to open only some splats of a scene that does not fit into memory."""

from __future__ import annotations

from imgui_bundle import imgui

from instdrive_app.language.translation import make_label
from instdrive_app.panels.dialogs.questions import draw_question
from instdrive_app.panels.widgets.ui import Ui
from instdrive_app.session.requests import AskTooLarge
from instdrive_core.errors import format_gigabytes, say_ordinal
from instdrive_core.wording import phrase

TITLE = "The scene is too large"


class TooLargeDialog:
    """Opens every k-th splat of the scene, or nothing."""

    def __init__(self) -> None:
        self._request: AskTooLarge | None = None
        """The request, until the user has answered it."""

    def open(self, ui: Ui, request: AskTooLarge) -> None:
        """Open it."""
        self._request = request
        imgui.open_popup(make_label(TITLE))

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        if self._request is None:
            return
        path, found = self._request.path, self._request.error
        keep_every = found.keep_every or found.count
        every = say_ordinal(keep_every)

        def open_part() -> None:
            self._request = None
            ui.session.files.open(path, keep_every=keep_every)

        def cancel() -> None:
            self._request = None

        text = phrase(
            "{name} has {count:,} splats. Editing it needs {needed} of memory; {available} are free. "
            "Open every {ordinal} splat?\n\nThe splats are then made larger, so that they leave no gaps. "
            "The file does not change.",
            name=path.name,
            count=found.count,
            needed=format_gigabytes(found.needed),
            available=format_gigabytes(found.available),
            ordinal=every,
        )
        draw_question(ui, TITLE, text, {"Cancel": cancel, phrase("Open every {ordinal}", ordinal=every): open_part})
