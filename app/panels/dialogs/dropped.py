"""What to do with files dropped onto the window."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from imgui_bundle import imgui

from instdrive_app.files.file_names import join_names
from instdrive_app.panels.dialogs.dropped_files import DroppedFiles, sort_dropped
from instdrive_app.panels.dialogs.file_purposes import PURPOSES
from instdrive_app.panels.dialogs.questions import Answers, draw_question
from instdrive_app.panels.widgets.ui import Ui
from instdrive_app.session.editor_session import EditorSession

TITLE = "Dropped files"


class DroppedDialog:
    """Opens what is dropped; where a scene is open already it asks whether to insert it there."""

    names: tuple[str, ...] = ()

    def __init__(self) -> None:
        self._asked: DroppedFiles | None = None

    def ask(self, ui: Ui, name: str) -> None:
        """Never by name."""

    def draw(self, ui: Ui) -> None:
        """One frame: `session.dropped` is taken up."""
        session = ui.session
        dropped, session.dropped = session.dropped, ()
        if dropped:
            self._receive(session, dropped)
        if self._asked is not None:
            text, answers = _compose_question(session, self._asked)
            draw_question(ui, TITLE, text, answers)

    def _receive(self, session: EditorSession, dropped: Sequence[Path]) -> None:
        if session.jobs.blocking:
            session.messages.error("Please wait until the work under way is done, then drop again")
            return
        if imgui.internal.get_top_most_popup_modal() is not None:
            # Another question would close the one that is open, without an answer.
            session.messages.error("Please finish with the dialog that is open, then drop again")
            return
        found = sort_dropped(dropped)
        if found.complaint:
            session.messages.error(found.complaint)
        if not found.openable:
            return
        if session.document is None or not found.scenes:
            _open_first(session, found)
        else:
            self._asked = found
            imgui.open_popup(TITLE)


def _compose_question(session: EditorSession, found: DroppedFiles) -> tuple[str, Answers]:
    """The question, and what its answers do."""
    first = found.openable[0]

    def insert() -> None:
        _insert(session, found)

    def open_first() -> None:
        _open_first(session, found)

    if len(found.openable) == 1:
        text = f"{first.name} can be opened instead of this scene, or inserted into it."
        return text, {"Cancel": lambda: None, "Insert": insert, "Open": open_first}
    beside = ", side by side" if len(found.scenes) > 1 else ""
    text = (
        f"{join_names(found.scenes)} can be inserted into this scene{beside}. "
        f"Only one can be opened instead of it: {first.name}."
    )
    return text, {"Cancel": lambda: None, "Open the first": open_first, "Insert": insert}


def _open_first(session: EditorSession, found: DroppedFiles) -> None:
    first, *others = found.openable
    PURPOSES["open"].act(session, first)
    if others:
        session.messages.info(f"One scene is open at a time: {first.name}. Left out: {join_names(others)}")


def _insert(session: EditorSession, found: DroppedFiles) -> None:
    session.inserting.insert(*found.scenes)
    if found.projects:
        session.messages.info(f"Projects can be opened, not inserted. Left out: {join_names(found.projects)}")
