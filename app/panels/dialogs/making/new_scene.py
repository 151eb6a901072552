"""Asks what a new scene is to be made of, shows what that is, and begins the job."""

from __future__ import annotations

import os.path
import time
from pathlib import Path

from imgui_bundle import ImVec2, imgui

from instdrive_app.files.file_names import find_working_folder, is_displayable
from instdrive_app.files.folder_listing import list_folder
from instdrive_app.language.translation import make_label, translate
from instdrive_app.panels.dialogs.frame import center_next_window, draw_confirm_buttons
from instdrive_app.panels.dialogs.making.job_fields import draw_minutes, propose_run_folder
from instdrive_app.panels.widgets.theme import rgba
from instdrive_app.panels.widgets.ui import Ui, draw_dim_text, get_icon
from instdrive_app.preferences.themes import ERROR
from instdrive_app.session.making.job_controller import SourceLook, find_out_problem
from instdrive_app.session.requests import AskNewScene

TITLE = "New from photos, video or a drive"
VIDEO_ENDINGS = (".mp4", ".mov", ".avi", ".mkv", ".webm", ".m4v")
QUALITIES = (("First look", 5.0), ("Good", 20.0), ("Fine", 60.0))
"""Names and minutes that are proposed."""
_TYPING_SECONDS = 0.4
"""A path is looked at when nothing was typed for so long."""
_STAY = imgui.SelectableFlags_.no_auto_close_popups


class NewSceneDialog:
    """Source at the top, what it is below, minutes and folder at the bottom."""

    def __init__(self) -> None:
        self._source, self._typed_at = "", 0.0
        self._minutes = QUALITIES[1][1]
        self._out, self._proposed = "", ""

    def open(self, ui: Ui, request: AskNewScene) -> None:
        """Open it, for what was dropped or in the folder used last."""
        if request.source is not None:
            self._source = str(request.source)
        elif not self._source:
            self._source = f"{find_working_folder()}{os.path.sep}"
        self._typed_at, ui.session.making.look = 0.0, None
        imgui.open_popup(make_label(TITLE))

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        em = imgui.get_font_size()
        center_next_window(ImVec2(44 * em, 0))
        if not imgui.begin_popup_modal(make_label(TITLE), None, imgui.WindowFlags_.no_saved_settings)[0]:
            return
        entered = self._draw_source(ui)
        source = Path(os.path.expanduser(self._source))
        self._look(ui, source)
        look = ui.session.making.look
        self._draw_facts(ui, look if look is not None and look.source == source else None)
        self._draw_quality(ui)
        out = self._draw_out(ui, source)
        problem = self._find_problem(ui, source, out)
        if problem:
            imgui.push_text_wrap_pos(0)
            imgui.text_colored(rgba(ERROR), translate(problem))
            imgui.pop_text_wrap_pos()
        is_ready = look is not None and look.source == source and look.is_ready and not look.problem
        if draw_confirm_buttons(ui, "Start", entered, is_ready and not problem):
            ui.session.making.begin(source, out, self._minutes)
        imgui.end_popup()

    def _draw_source(self, ui: Ui) -> bool:
        """The path, and the folders and videos beside it; returns whether Enter was pressed in the path."""
        imgui.text(translate("Folder of photos, video, or folder of a driving data set"))
        if imgui.is_window_appearing():
            imgui.set_keyboard_focus_here()
        imgui.set_next_item_width(-1)
        before = self._source
        entered, self._source = imgui.input_text("##source", before, imgui.InputTextFlags_.enter_returns_true)
        ui.mark("new.source")
        if self._source != before:
            self._typed_at = time.monotonic()
        path = Path(os.path.expanduser(self._source))
        is_folder = os.path.isdir(path)
        rows = 6 * imgui.get_text_line_height_with_spacing()
        if imgui.begin_child("##entries", ImVec2(0, rows), imgui.ChildFlags_.borders):
            folder = path if is_folder else path.parent
            if folder.parent != folder and imgui.selectable(f"{get_icon('ICON_FA_ARROW_UP')}   ..", False, _STAY)[0]:
                self._choose(folder.parent)
            for entry in list_folder(folder, VIDEO_ENDINGS, lambda _: False):
                symbol = get_icon("ICON_FA_FOLDER" if entry.size is None else "ICON_FA_FILM")
                if imgui.selectable(f"{symbol}   {entry.path.name}", entry.path == path, _STAY)[0]:
                    self._choose(entry.path)
                ui.mark(f"new.entry.{entry.path.name}")
        imgui.end_child()
        return entered

    def _choose(self, path: Path) -> None:
        self._source = str(path)
        self._typed_at = 0.0

    def _look(self, ui: Ui, source: Path) -> None:
        """Look at the source, once it is no longer typed."""
        making = ui.session.making
        known = making.look is not None and making.look.source == source
        if known or time.monotonic() - self._typed_at < _TYPING_SECONDS:
            return
        if os.path.exists(source) and is_displayable(source):
            making.look_at(source)

    def _draw_facts(self, ui: Ui, look: SourceLook | None) -> None:
        height = 9 * imgui.get_text_line_height_with_spacing()
        if imgui.begin_child("##facts", ImVec2(0, height)):
            if look is None:
                draw_dim_text(translate("Choose what the scene is to be made of."))
            elif not look.is_ready:
                draw_dim_text(translate("Looking at {name}…", name=look.source.name))
            imgui.push_text_wrap_pos(0)
            if look is not None and look.title:
                imgui.text(translate(look.title))
                ui.mark("new.found")
            for label, text in _order_facts(look.facts) if look is not None else ():
                draw_dim_text(translate(label.strip()))
                imgui.same_line(9 * imgui.get_font_size())
                imgui.text(translate(text))
            if look is not None and look.problem:
                imgui.text_colored(rgba(ERROR), translate(look.problem))
                ui.mark("new.problem")
            imgui.pop_text_wrap_pos()
        imgui.end_child()

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


def _order_facts(facts: tuple[tuple[str, str], ...]) -> list[tuple[str, str]]:
    """What the whole source has first, masks at the top; each camera, whose label is indented, after that."""
    return sorted(facts, key=lambda fact: (fact[0].startswith(" "), fact[0] != "masks"))


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
