"""Asking whether a part of a scene is opened that does not fit into memory whole."""

from __future__ import annotations

from imgui_bundle import imgui

from instdrive_app.panels.dialogs.questions import draw_question
from instdrive_app.panels.widgets.ui import Ui
from instdrive_core.errors import format_gigabytes, format_ordinal

TITLE = "The scene is too large"


class TooLargeDialog:
    """Opens itself when `files.too_large` is set."""

    names: tuple[str, ...] = ()

    def ask(self, ui: Ui, name: str) -> None:
        """Never by name."""

    def draw(self, ui: Ui) -> None:
        """One frame."""
        files = ui.session.files
        if files.too_large is None:
            return
        path, found = files.too_large
        if not imgui.is_popup_open(TITLE):
            imgui.open_popup(TITLE)
        keep_every = found.keep_every or found.count
        every = f"every {format_ordinal(keep_every)}"

        def open_part() -> None:
            files.too_large = None
            files.open(path, keep_every=keep_every)

        def leave() -> None:
            files.too_large = None

        text = (
            f"{path.name} has {found.count:,} splats and needs {format_gigabytes(found.needed)} to be edited, "
            f"{format_gigabytes(found.available)} are free. Open {every} splat?\n\n"
            "The splats that are opened are made larger, so that they leave no gaps. The file stays as it is."
        )
        draw_question(ui, TITLE, text, {"Cancel": leave, f"Open {every}": open_part})
