"""What to do with a file dropped onto the window."""

from __future__ import annotations

from pathlib import Path

from imgui_bundle import imgui

from instdrive_app.panels.dialogs.file_purposes import PURPOSES
from instdrive_app.panels.dialogs.questions import Answers, question
from instdrive_app.panels.ui import Ui

TITLE = "Dropped file"


class DroppedDialog:
    """Opens what is dropped; where a scene is open already it asks whether to insert it there."""

    names: tuple[str, ...] = ()

    def __init__(self) -> None:
        self._asked: Path | None = None

    def ask(self, ui: Ui, name: str) -> None:
        """Never by name."""

    def draw(self, ui: Ui) -> None:
        """One frame: `session.dropped` is taken up."""
        session = ui.session
        path, session.dropped = session.dropped, None
        if path is not None:
            self._take(ui, path)
        if self._asked is None:
            return
        asked = self._asked
        answers: Answers = {
            "Cancel": lambda: None,
            "Insert": lambda: PURPOSES["insert"].act(session, asked),
            "Open": lambda: PURPOSES["open"].act(session, asked),
        }
        question(ui, TITLE, f"{asked.name} can be opened instead of this scene, or inserted into it.", answers)

    def _take(self, ui: Ui, path: Path) -> None:
        problem = PURPOSES["open"].problem(path)
        if problem:
            ui.session.messages.error(f"{path.name} cannot be opened. {problem}")
        elif ui.session.document is None or PURPOSES["insert"].problem(path):
            PURPOSES["open"].act(ui.session, path)
        else:
            self._asked = path
            imgui.open_popup(TITLE)
