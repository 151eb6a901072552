"""Opens or inserts files that were dropped onto the window."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from imgui_bundle import imgui

from instdrive_app.files.file_names import join_names
from instdrive_app.language.translation import make_label
from instdrive_app.panels.dialogs.dropped_files import DroppedFiles, sort_dropped
from instdrive_app.panels.dialogs.making.new_scene import may_be_source
from instdrive_app.panels.dialogs.questions import Answers, draw_question
from instdrive_app.panels.widgets.ui import Ui
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.session.requests import AskNewScene, ReceiveDrop
from instdrive_core.wording import phrase

TITLE = "Dropped files"


class DroppedDialog:
    """Opens dropped files; if a scene is open already, it asks whether to insert them there."""

    def __init__(self) -> None:
        self._asked: DroppedFiles | None = None

    def open(self, ui: Ui, request: ReceiveDrop) -> None:
        """Open or insert the files at once, or open the dialog that asks."""
        self._receive(ui.session, request.paths)

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        if self._asked is not None:
            text, answers = _compose_question(ui.session, self._asked)
            draw_question(ui, TITLE, text, answers)

    def _receive(self, session: EditorSession, dropped: Sequence[Path]) -> None:
        if session.jobs.is_blocking:
            session.messages.error("Please wait until the present job is done, then drop the files again")
            return
        if imgui.internal.get_top_most_popup_modal() is not None:
            # Another question would close the one that is open, without an answer.
            session.messages.error("Please close the open dialog, then drop the files again")
            return
        found = sort_dropped(dropped)
        if not found.openable and len(dropped) == 1 and may_be_source(dropped[0]):
            session.requests.put(AskNewScene(dropped[0]))
            return
        if found.complaint:
            session.messages.error(found.complaint)
        if not found.openable:
            return
        if session.document is None or not found.scenes:
            _open_first(session, found)
        else:
            self._asked = found
            imgui.open_popup(make_label(TITLE))


def _compose_question(session: EditorSession, found: DroppedFiles) -> tuple[str, Answers]:
    """Text of the question, and what its answers do."""
    first = found.openable[0]

    def insert() -> None:
        _insert(session, found)

    def open_first() -> None:
        _open_first(session, found)

    if len(found.openable) == 1:
        text = phrase("Open {name} instead of this scene, or insert it into this scene?", name=first.name)
        return text, {"Cancel": lambda: None, "Insert": insert, "Open": open_first}
    names = join_names(found.scenes)
    text = phrase(
        "{names} can be inserted into this scene. Only the first, {name}, can be opened instead.",
        names=names,
        name=first.name,
    )
    if len(found.scenes) > 1:
        text = phrase(
            "{names} can be inserted into this scene, side by side. Only the first, {name}, can be opened instead.",
            names=names,
            name=first.name,
        )
    return text, {"Cancel": lambda: None, "Open the first": open_first, "Insert": insert}


def _open_first(session: EditorSession, found: DroppedFiles) -> None:
    first, *others = found.openable
    session.files.leave_for(first)
    if others:
        session.messages.info(
            phrase(
                "Only one scene can be open at a time: {name}. Left out: {names}",
                name=first.name,
                names=join_names(others),
            )
        )


def _insert(session: EditorSession, found: DroppedFiles) -> None:
    session.insertion.insert(*found.scenes)
    if found.projects:
        session.messages.info(
            phrase("Projects can be opened but not inserted. Left out: {names}", names=join_names(found.projects))
        )
