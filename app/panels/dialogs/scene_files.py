"""Asking for a path: by the desktop's own dialog where there is one, else by a small file browser in the window."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from imgui_bundle import ImVec2, imgui
from imgui_bundle import portable_file_dialogs as desktop

from instdrive_app.panels.dialogs.frame import confirmed
from instdrive_app.panels.ui import Ui, dim_text, icon
from instdrive_app.theme import ERROR, rgba
from instdrive_core.formats.registry import FORMATS
from instdrive_core.formats.scene_folder import MANIFEST

TITLES = {"open": "Open a scene", "export": "Export the edited scene"}
DESKTOP_TOOLS = ("zenity", "kdialog", "matedialog", "qarma")
OPENED = tuple(fmt.suffix for fmt in FORMATS if fmt.suffix)
WRITTEN = tuple(fmt.suffix for fmt in FORMATS if fmt.suffix and fmt.write is not None)
"""Endings of the formats that can be opened and written."""


class FileDialog:
    """The answer goes to the session."""

    names: tuple[str, ...] = ("open", "export")

    def __init__(self) -> None:
        self._purpose = "open"
        self._folder = Path.cwd()
        self._text = ""
        self._pending: desktop.open_file | desktop.save_file | None = None

    def ask(self, ui: Ui, name: str) -> None:
        """Ask for the scene to ``open`` or the file to ``export`` to."""
        purpose = self._purpose = name
        current = ui.session.files.last_export or ui.session.files.path
        self._folder = current.resolve().parent if current else Path.cwd()
        self._text = str(self._suggestion(ui)) if purpose == "export" else str(self._folder) + "/"
        if not has_desktop_dialogs():
            imgui.open_popup(TITLES[purpose])
        elif purpose == "open":
            self._pending = desktop.open_file(
                TITLES["open"], self._text, ["Scenes", " ".join(f"*{suffix}" for suffix in OPENED)]
            )
        else:
            self._pending = desktop.save_file(
                TITLES["export"], self._text, ["Gaussians", " ".join(f"*{suffix}" for suffix in WRITTEN)]
            )

    def draw(self, ui: Ui) -> None:
        """One frame."""
        if self._pending is not None and self._pending.ready(0):
            result = self._pending.result()
            self._pending = None
            answer = result[0] if isinstance(result, list) and result else result
            if isinstance(answer, str) and answer:
                self._finish(ui, Path(answer))
        for purpose, title in TITLES.items():
            imgui.set_next_window_pos(imgui.get_main_viewport().get_center(), imgui.Cond_.appearing, ImVec2(0.5, 0.5))
            imgui.set_next_window_size(ImVec2(600, 420), imgui.Cond_.appearing)
            if imgui.begin_popup_modal(title, None, imgui.WindowFlags_.no_saved_settings)[0]:
                self._browser(ui, purpose)
                imgui.end_popup()

    def _suggestion(self, ui: Ui) -> Path:
        if ui.session.files.last_export is not None:
            return ui.session.files.last_export
        stem = ui.session.files.path.stem if ui.session.files.path else "scene"
        return self._folder / f"{stem}_edited.ply"

    def _browser(self, ui: Ui, purpose: str) -> None:
        imgui.set_next_item_width(-1)
        if imgui.is_window_appearing():
            imgui.set_keyboard_focus_here()
        entered, self._text = imgui.input_text("##path", self._text, imgui.InputTextFlags_.enter_returns_true)
        ui.mark("dialog.path")
        path = Path(self._text).expanduser()
        folder = path if path.is_dir() else path.parent
        if imgui.begin_child("##entries", ImVec2(0, -imgui.get_frame_height() * 2.6), imgui.ChildFlags_.borders):
            self._entries(folder)
        imgui.end_child()
        problem = _problem(purpose, path)
        if problem:
            imgui.text_colored(rgba(ERROR), problem)
        else:
            dim_text("The file is replaced." if purpose == "export" and path.is_file() else " ")
        if confirmed(ui, "Open" if purpose == "open" else "Export", entered, not problem):
            self._finish(ui, path)

    def _entries(self, folder: Path) -> None:
        if folder.parent != folder and imgui.selectable(f"{icon('ICON_FA_ARROW_UP')}   ..", False, _STAY)[0]:
            self._text = str(folder.parent) + "/"
        for entry in _listing(folder):
            is_scene = entry.is_file() or (entry / MANIFEST).is_file()
            symbol = icon("ICON_FA_CUBES" if is_scene else "ICON_FA_FOLDER")
            if imgui.selectable(f"{symbol}   {entry.name}", False, _STAY)[0]:
                self._text = str(entry) if is_scene else str(entry) + "/"

    def _finish(self, ui: Ui, path: Path) -> None:
        if self._purpose == "open":
            ui.session.files.open(path)
        else:
            ui.session.export(path)


_STAY = imgui.SelectableFlags_.no_auto_close_popups


def has_desktop_dialogs() -> bool:
    """Whether the desktop brings file dialogs; on Linux they are programs that may be missing."""
    return not sys.platform.startswith("linux") or any(shutil.which(tool) for tool in DESKTOP_TOOLS)


def _listing(folder: Path) -> list[Path]:
    """Folders and scene files, folders first; nothing where the folder cannot be read."""
    try:
        entries = [entry for entry in folder.iterdir() if not entry.name.startswith(".")]
    except OSError:
        return []
    wanted = [entry for entry in entries if entry.is_dir() or entry.name.lower().endswith(OPENED)]
    return sorted(wanted, key=lambda entry: (entry.is_file(), entry.name.lower()))


def _problem(purpose: str, path: Path) -> str:
    if purpose == "open":
        scene = path.is_file() or (path / MANIFEST).is_file()
        return "" if scene else "Choose a scene file or a folder that holds a scene"
    if path.is_dir() and not (path / MANIFEST).is_file():
        return "Add a file name that ends in .ply"
    if path.suffix and not path.name.lower().endswith(WRITTEN):
        return f"The name must end in {' or '.join(WRITTEN)}, or be that of a scene folder"
    return "" if path.parent.is_dir() else f"There is no folder {path.parent}"
