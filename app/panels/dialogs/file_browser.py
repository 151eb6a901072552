"""Asks for a path with the desktop's own dialog or, if there is none, with a file browser in the window."""

from __future__ import annotations

import os.path
import shutil
import sys
import time
from pathlib import Path

from imgui_bundle import ImVec2, imgui
from imgui_bundle import portable_file_dialogs as desktop

from instdrive_app.files.file_names import find_folder_beside, find_working_folder
from instdrive_app.files.folder_listing import FolderEntry, list_folder
from instdrive_app.language.translation import make_label, translate
from instdrive_app.panels.dialogs.export import ExportOptions
from instdrive_app.panels.dialogs.file_purposes import PURPOSES, FilePurpose, holds_scene
from instdrive_app.panels.dialogs.frame import center_next_window, draw_confirm_buttons
from instdrive_app.panels.widgets.theme import rgba
from instdrive_app.panels.widgets.ui import Ui, draw_dim_text, get_icon
from instdrive_app.preferences.themes import DIM, ERROR
from instdrive_app.session.requests import AskExport, AskPath, do_nothing
from instdrive_core.wording import phrase

TITLE = "Choose a file"
"""What the dialog is listed as; its window is titled by the purpose."""
DESKTOP_TOOLS = ("zenity", "kdialog", "matedialog", "qarma")
RELIST_SECONDS = 1.0
"""Interval at which the folder on screen is read again."""
_STAY = imgui.SelectableFlags_.no_auto_close_popups


class FileBrowser:
    """One dialog for all `PURPOSES`; each purpose knows what to do with the answer."""

    def __init__(self) -> None:
        self._export = ExportOptions()
        self._options: ExportOptions | None = None
        self._purpose = PURPOSES["open"]
        self._folder = find_working_folder()
        self._text = ""
        self._then = do_nothing
        """What follows a save; a user who enters no name wants to stay, so that nothing follows."""
        self._pending: desktop.open_file | desktop.save_file | None = None
        self._listed: tuple[tuple[Path, tuple[str, ...]], float, list[FolderEntry]] | None = None

    def open(self, ui: Ui, request: AskPath | AskExport) -> None:
        """Ask for a path, in the folder of the file used last."""
        self._listed = None
        if isinstance(request, AskExport):
            # Never the desktop's dialog: it has no room for what is asked beside the path.
            self._options, self._then = self._export, do_nothing
            self._text = self._options.begin(ui.session, request.what)
            self._purpose = self._options.build_purpose(ui.session)
            imgui.open_popup(make_label(self._purpose.title))
            return
        self._options, self._then = None, request.then
        purpose = self._purpose = PURPOSES[request.purpose]
        files = ui.session.files
        current = files.project or files.path
        folder = find_folder_beside(current)
        stem = current.name.split(".")[0].removesuffix("_edited") if current else "scene"
        self._text = str(folder / f"{stem}{purpose.suggestion}") if purpose.writes else f"{folder}/"
        if not has_desktop_dialogs():
            imgui.open_popup(make_label(purpose.title))
            return
        endings = " ".join(f"*{suffix}" for suffix in purpose.suffixes)
        dialog = desktop.save_file if purpose.writes else desktop.open_file
        self._pending = dialog(translate(purpose.title), self._text, [translate("Scenes"), endings])

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        if self._pending is not None and self._pending.ready(0):
            self._take_answer(ui)
        em, options = imgui.get_font_size(), self._options
        center_next_window(
            ImVec2(46 * em, 29 * em + (0 if options is None else options.rows * imgui.get_frame_height_with_spacing()))
        )
        if imgui.begin_popup_modal(make_label(self._purpose.title), None, imgui.WindowFlags_.no_saved_settings)[0]:
            if options is not None:
                self._text = options.draw(ui, self._text)
                self._purpose = options.build_purpose(ui.session)
            self._draw_browser(ui, self._purpose)
            imgui.end_popup()

    def _take_answer(self, ui: Ui) -> None:
        assert self._pending is not None
        result, self._pending = self._pending.result(), None
        answer = result[0] if isinstance(result, list) and result else result
        if isinstance(answer, str) and answer:
            path = Path(answer)
            path = self._purpose.complete(path)
            problem = self._purpose.find_problem(path)
            if problem:
                ui.session.messages.error(phrase("{path}: {problem}", path=path, problem=phrase(problem)))
            else:
                self._purpose.act(ui.session, path, self._then)

    def _draw_browser(self, ui: Ui, purpose: FilePurpose) -> None:
        if imgui.is_window_appearing():
            imgui.set_keyboard_focus_here()
        imgui.set_next_item_width(-1)
        entered, self._text = imgui.input_text("##path", self._text, imgui.InputTextFlags_.enter_returns_true)
        ui.mark("dialog.path")
        path = Path(os.path.expanduser(self._text))  # unlike Path's method, leaves what is nobody's home
        folder = path if os.path.isdir(path) and not holds_scene(path) else path.parent
        below = ImVec2(0, -imgui.get_frame_height() * 2.7)
        if imgui.begin_child("##places", ImVec2(11 * imgui.get_font_size(), below.y)):
            self._draw_places(ui)
        imgui.end_child()
        imgui.same_line()
        if imgui.begin_child("##entries", below, imgui.ChildFlags_.borders):
            self._draw_entries(ui, folder, path)
        imgui.end_child()
        path = purpose.complete(path)
        problem = purpose.find_problem(path)
        if problem:
            imgui.text_colored(rgba(DIM if os.path.isdir(path) else ERROR), translate(problem))
        else:
            draw_dim_text(translate(_describe_consequence(purpose, path)))
        if draw_confirm_buttons(ui, purpose.verb, entered, not problem):
            purpose.act(ui.session, path, self._then)

    def _draw_places(self, ui: Ui) -> None:
        places = {"ICON_FA_HOUSE": Path.home(), "ICON_FA_FOLDER_TREE": find_working_folder()}
        for symbol, place in places.items():
            if imgui.selectable(f"{get_icon(symbol)}   {place.name or place}##{symbol}", False, _STAY)[0]:
                self._show_folder(place)
        recents = ui.session.files.recents.paths
        if recents:
            imgui.spacing()
            draw_dim_text(translate("Recent"))
        for recent in recents:
            if imgui.selectable(f"{recent.name}##{recent}", False, _STAY)[0]:
                self._choose(recent)
            if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
                imgui.set_tooltip(str(recent))

    def _draw_entries(self, ui: Ui, folder: Path, path: Path) -> None:
        flags = imgui.TableFlags_.row_bg | imgui.TableFlags_.scroll_y | imgui.TableFlags_.no_borders_in_body
        if not imgui.begin_table("##files", 3, flags):
            return
        em, fixed = imgui.get_font_size(), imgui.TableColumnFlags_.width_fixed
        imgui.table_setup_column(make_label("Name"), imgui.TableColumnFlags_.width_stretch)
        imgui.table_setup_column(make_label("Size"), fixed, 4.5 * em)
        imgui.table_setup_column(make_label("Modified"), fixed, 7 * em)
        imgui.table_setup_scroll_freeze(0, 1)
        imgui.table_headers_row()
        if folder.parent != folder:
            imgui.table_next_row()
            imgui.table_set_column_index(0)
            if imgui.selectable(f"{get_icon('ICON_FA_ARROW_UP')}   ..", False, _STAY)[0]:
                self._show_folder(folder.parent)
        for entry in self._list_folder(folder):
            self._draw_entry(ui, entry, entry.path == path)
        imgui.end_table()

    def _draw_entry(self, ui: Ui, entry: FolderEntry, chosen: bool) -> None:
        imgui.table_next_row()
        imgui.table_set_column_index(0)
        symbol = get_icon("ICON_FA_CUBES" if entry.is_scene else "ICON_FA_FOLDER")
        flags = _STAY | imgui.SelectableFlags_.span_all_columns | imgui.SelectableFlags_.allow_double_click
        if imgui.selectable(f"{symbol}   {entry.path.name}", chosen, flags)[0]:
            if not entry.is_scene:
                self._show_folder(entry.path)
            elif not self._purpose.writes and imgui.is_mouse_double_clicked(0):
                imgui.close_current_popup()
                self._purpose.act(ui.session, entry.path, self._then)
            else:
                self._choose(entry.path)
        ui.mark(f"browser.{entry.path.name}")
        for column, text in ((1, entry.size_text), (2, entry.changed_text)):
            imgui.table_set_column_index(column)
            imgui.text_colored(rgba(DIM), text)

    def _list_folder(self, folder: Path) -> list[FolderEntry]:
        now, key = time.monotonic(), (folder, self._purpose.suffixes)
        if self._listed is None or self._listed[0] != key or now - self._listed[1] > RELIST_SECONDS:
            self._listed = (key, now, list_folder(folder, self._purpose.suffixes, holds_scene))
        return self._listed[2]

    def _show_folder(self, folder: Path) -> None:
        """Show another folder; the name of a file to be written is kept."""
        name = Path(self._text).name if self._purpose.writes else ""
        self._text = str(folder / name) if name else f"{str(folder).rstrip('/')}/"

    def _choose(self, path: Path) -> None:
        self._text = str(path)


def _describe_consequence(purpose: FilePurpose, path: Path) -> str:
    """Say what happens to an existing file or folder."""
    if purpose.writes and os.path.isfile(path):
        return "The existing file will be replaced."
    if purpose.writes and os.path.isdir(path):
        scene, files = "The existing scene will be replaced.", "Existing files with the same names will be replaced."
        return scene if purpose.suffixes else files
    return " "


def has_desktop_dialogs() -> bool:
    """Whether the desktop has file dialogs; on Linux these are separate programs that may be missing."""
    return not sys.platform.startswith("linux") or any(shutil.which(tool) for tool in DESKTOP_TOOLS)
