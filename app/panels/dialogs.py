"""The rename box and the sheet of keys; `DialogHost` opens whichever the session asks for."""

from __future__ import annotations

from imgui_bundle import ImVec2, imgui

from instdrive_app.panels.file_dialog import FileDialog
from instdrive_app.panels.menus import shortcut_title
from instdrive_app.panels.ui import Ui, dim_text

MOUSE = (
    ("Left click", "Select the object; again at the same place: the one behind"),
    ("Shift + click", "Add to the selection"),
    ("Ctrl + click", "Remove from the selection"),
    ("Alt + click", "Select everything of the same codeword"),
    ("Right click", "Menu of the object"),
    ("Left drag", "Orbit around what was under the cursor"),
    ("Right drag", "Look around"),
    ("Middle drag, Shift + drag", "Pan"),
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
    accepted = imgui.button(title, ImVec2(width, 0))
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
    _centered(ImVec2(760, 0))
    if not imgui.begin_popup_modal("Keys and mouse", None, imgui.WindowFlags_.no_saved_settings)[0]:
        return
    commands = [command for command in ui.session.commands if command.shortcuts]
    keys = [(" or ".join(map(shortcut_title, command.shortcuts)), command.title) for command in commands]
    if imgui.begin_table("##sheet", 2, imgui.TableFlags_.sizing_stretch_same):
        for rows in (keys, MOUSE):
            imgui.table_next_column()
            for key, title in rows:
                dim_text(key)
                imgui.same_line(imgui.get_font_size() * 9.5)
                imgui.text_wrapped(title)
        imgui.end_table()
    imgui.spacing()
    closed = imgui.button("Close", ImVec2(92, 0))
    ui.mark("dialog.cancel")
    if closed or imgui.is_key_pressed(imgui.Key.escape):
        imgui.close_current_popup()
    imgui.end_popup()
