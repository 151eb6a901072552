"""Asks what a new scene is to be made of, shows what that is, and begins the job."""

from __future__ import annotations

import os.path
from pathlib import Path

from imgui_bundle import ImVec2, imgui

from instdrive_app.files.file_names import find_working_folder, is_displayable
from instdrive_app.language.translation import make_label, translate
from instdrive_app.panels.dialogs.frame import center_next_window, draw_confirm_buttons
from instdrive_app.panels.dialogs.making.job_fields import draw_minutes, propose_run_folder
from instdrive_app.panels.dialogs.making.source_field import SourceField
from instdrive_app.panels.widgets.theme import rgba
from instdrive_app.panels.widgets.ui import Ui
from instdrive_app.preferences.themes import ERROR
from instdrive_app.session.making.job_controller import find_out_problem
from instdrive_app.session.requests import AskNewScene

TITLE = "New from photos, video or a drive"
VIDEO_ENDINGS = (".mp4", ".mov", ".avi", ".mkv", ".webm", ".m4v")
QUALITIES = (("First look", 5.0), ("Good", 20.0), ("Fine", 60.0))
"""Names and minutes that are proposed."""


class NewSceneDialog:
    """Source at the top, what it is below, minutes and folder at the bottom."""

    def __init__(self) -> None:
        self._source = SourceField("new", VIDEO_ENDINGS)
        self._minutes = QUALITIES[1][1]
        self._out, self._proposed = "", ""

    def open(self, ui: Ui, request: AskNewScene) -> None:
        """Open it, for what was dropped or in the folder used last."""
        chosen = self._source.text or f"{find_working_folder()}{os.path.sep}"
        self._source.reset(ui, chosen if request.source is None else str(request.source))
        imgui.open_popup(make_label(TITLE))

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        em = imgui.get_font_size()
        center_next_window(ImVec2(44 * em, 0))
        if not imgui.begin_popup_modal(make_label(TITLE), None, imgui.WindowFlags_.no_saved_settings)[0]:
            return
        entered = self._source.draw(ui, "Folder of photos, video, or folder of a driving data set")
        look, source = self._source.find_look(ui), self._source.path
        self._source.draw_look(ui, look, "Choose what the scene is to be made of.")
        self._draw_quality(ui)
        out = self._draw_out(ui, source)
        problem = self._find_problem(ui, source, out)
        if problem:
            imgui.push_text_wrap_pos(0)
            imgui.text_colored(rgba(ERROR), translate(problem))
            imgui.pop_text_wrap_pos()
        is_ready = look is not None and look.is_ready and not look.problem
        if draw_confirm_buttons(ui, "Start", entered, is_ready and not problem):
            ui.session.making.begin(source, out, self._minutes)
        imgui.end_popup()

    def _draw_quality(self, ui: Ui) -> None:
        imgui.separator()
        self._minutes = draw_minutes(ui, "new", QUALITIES, self._minutes)

    def _draw_out(self, ui: Ui, source: Path) -> Path:
        """The folder of the run: proposed after the source until the user types another."""
        if self._out == self._proposed:
            self._out = self._proposed = str(_propose_folder(source))
        imgui.text(translate("Folder of the new scene"))
        imgui.set_next_item_width(-1)
        _, self._out = imgui.input_text("##out", self._out)
        ui.mark("new.out")
        return Path(os.path.expanduser(self._out))

    def _find_problem(self, ui: Ui, source: Path, out: Path) -> str:
        if ui.session.making.is_running:
            return "Another training is running. Wait for it, or stop it first."
        if not self._out.strip() or not is_displayable(out):
            return "Enter the folder of the new scene"
        return find_out_problem(out, source)


def _propose_folder(source: Path) -> Path:
    """A new folder among the user's documents, named after the source."""
    stem = source.stem if os.path.isfile(source) else source.name
    return propose_run_folder(f"{stem or 'new'} scene")


def may_be_source(path: Path) -> bool:
    """Whether a path may be what a scene can be made of, as far as a glance tells: a video, or a folder with files."""
    if os.path.isfile(path):
        return path.name.lower().endswith(VIDEO_ENDINGS)
    try:
        return is_displayable(path) and bool(os.listdir(path))
    except OSError:
        return False
