"""The steps done so far; a click goes to a step."""

from __future__ import annotations

from imgui_bundle import imgui

from instdrive_app.panels.ui import Ui
from instdrive_app.theme import DIM, rgba


class HistoryPanel:
    """Done steps in full, undone ones dimmed, the present one marked."""

    def __init__(self) -> None:
        self._seen = -1

    def draw(self, ui: Ui) -> None:
        """One frame."""
        document = ui.session.document
        if document is None:
            imgui.text_disabled("Nothing has been edited yet.")
            return
        history = document.history
        target: int | None = None
        for number, title in enumerate(["Opened", *(edit.title for edit in history.edits)]):
            undone = number > history.cursor
            if undone:
                imgui.push_style_color(imgui.Col_.text, rgba(DIM))
            if imgui.selectable(f"{title}##{number}", number == history.cursor)[0]:
                target = number
            ui.mark(f"history.{number}")
            if undone:
                imgui.pop_style_color()
            if number == history.cursor and self._seen != history.cursor:
                imgui.set_scroll_here_y(0.7)
        self._seen = history.cursor
        if target is not None:
            ui.session.jump(target)
