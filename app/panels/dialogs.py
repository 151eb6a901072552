"""The rename box and the sheet of keys; `DialogHost` opens whichever the session asks for."""

from __future__ import annotations

from imgui_bundle import ImVec2, imgui

from instdrive_app.panels.file_dialog import FileDialog
from instdrive_app.panels.menus import shortcut_title
from instdrive_app.panels.ui import Ui, dim_text
from instdrive_app.theme import ACCENT, BACKGROUND, rgba

MOUSE = (
    ("Click", "Select; again there: the one behind"),
    ("Shift + click", "Add to the selection"),
    ("Ctrl + click", "Remove from the selection"),
    ("Alt + click", "Select the whole codeword"),
    ("Right click", "Menu"),
    ("Left drag", "Orbit around what is under the cursor"),
    ("Right drag", "Look around"),
    ("Middle, Shift + drag", "Pan"),
    ("Wheel", "Nearer, farther"),
    ("W A S D, Q E", "Fly; with Shift: faster"),
)


class DialogHost:
    """Opens dialogs and draws the open one."""

    def __init__(self) -> None:
        self._files = FileDialog()
        self._name = ""

    def draw(self, ui: Ui) -> None:
        """One frame."""
        asked, ui.session.dialog = ui.session.dialog, None
        if asked in ("open", "export"):
            self._files.ask(ui, asked)
        elif asked == "rename":
            assert ui.session.document is not None
            self._name = ui.session.document.scene.table[ui.session.renamed].name
            imgui.open_popup("Rename")
        elif asked == "shortcuts":
            imgui.open_popup("Keys and mouse")
        self._files.draw(ui)
        self._rename(ui)
        _shortcut_sheet(ui)

    def _rename(self, ui: Ui) -> None:
        _centered(ImVec2(340, 0))
        if not imgui.begin_popup_modal("Rename", None, imgui.WindowFlags_.no_saved_settings)[0]:
            return
        if imgui.is_window_appearing():
            imgui.set_keyboard_focus_here()
        imgui.set_next_item_width(-1)
        flags = imgui.InputTextFlags_.enter_returns_true | imgui.InputTextFlags_.auto_select_all
        entered, self._name = imgui.input_text("##name", self._name, flags)
        ui.mark("rename.name")
        if confirmed(ui, "Rename", entered, bool(self._name.strip())):
            ui.session.rename(ui.session.renamed, self._name.strip())
        imgui.end_popup()


def confirmed(ui: Ui, title: str, entered: bool, valid: bool) -> bool:
    """The two buttons at the end of a dialog; closes it where one is pressed, or Escape."""
    imgui.spacing()
    width = 92.0
    imgui.set_cursor_pos_x(imgui.get_window_width() - 2 * width - 18)
    cancelled = imgui.button("Cancel", ImVec2(width, 0)) or imgui.is_key_pressed(imgui.Key.escape)
    ui.mark("dialog.cancel")
    imgui.same_line()
    imgui.begin_disabled(not valid)
    imgui.push_style_color(imgui.Col_.button, rgba(ACCENT, 0.9))
    imgui.push_style_color(imgui.Col_.text, rgba(BACKGROUND))
    accepted = imgui.button(title, ImVec2(width, 0))
    imgui.pop_style_color(2)
    ui.mark("dialog.accept")
    imgui.end_disabled()
    accepted = valid and (accepted or entered)
    if accepted or cancelled:
        imgui.close_current_popup()
    return accepted


def _centered(size: ImVec2) -> None:
    imgui.set_next_window_pos(imgui.get_main_viewport().get_center(), imgui.Cond_.appearing, ImVec2(0.5, 0.5))
    imgui.set_next_window_size(size)


def _shortcut_sheet(ui: Ui) -> None:
    _centered(ImVec2(820, 0))
    if not imgui.begin_popup_modal("Keys and mouse", None, imgui.WindowFlags_.no_saved_settings)[0]:
        return
    if imgui.begin_table("##sheet", 2, imgui.TableFlags_.sizing_stretch_same):
        imgui.table_next_column()
        for menu in ("File", "Edit", "Select"):
            _command_section(ui, menu)
        imgui.table_next_column()
        for menu in ("View", "Time"):
            _command_section(ui, menu)
        _sheet_section(ui, "Mouse", MOUSE)
        imgui.end_table()
    imgui.spacing()
    closed = imgui.button("Close", ImVec2(92, 0))
    ui.mark("dialog.cancel")
    if closed or imgui.is_key_pressed(imgui.Key.escape):
        imgui.close_current_popup()
    imgui.end_popup()


def _command_section(ui: Ui, menu: str) -> None:
    commands = [command for command in ui.session.commands.in_menu(menu) if command.shortcuts]
    rows = [(", ".join(map(shortcut_title, command.shortcuts)), command.title) for command in commands]
    _sheet_section(ui, menu, tuple(rows))


def _sheet_section(ui: Ui, title: str, rows: tuple[tuple[str, str], ...]) -> None:
    imgui.push_font(ui.fonts.bold, 0.0)
    imgui.text(title)
    imgui.pop_font()
    for key, action in rows:
        dim_text(key)
        imgui.same_line(imgui.get_cursor_start_pos().x + imgui.get_font_size() * 10)
        imgui.text_wrapped(action)
    imgui.spacing()
