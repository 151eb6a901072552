"""The sheet of keys and mouse moves."""

from __future__ import annotations

from imgui_bundle import ImVec2, imgui

from instdrive_app.panels.dialogs.frame import centered
from instdrive_app.panels.menus import shortcut_title
from instdrive_app.panels.ui import Ui, dim_text

TITLE = "Keys and mouse"
MOUSE = (
    ("Click", "Select; again there: the one behind"),
    ("Shift + click", "Add to the selection"),
    ("Ctrl + click", "Remove from the selection"),
    ("Alt + click", "Select the whole codeword"),
    ("Shift + Ctrl", "With a region: keep what is inside"),
    ("Right click", "Menu"),
    ("Left drag", "Orbit around what is under the cursor, or draw the tool's region"),
    ("Right drag", "Look around"),
    ("Middle, Shift + drag", "Pan"),
    ("Wheel", "Nearer, farther"),
    ("W A S D, Q E", "Fly; with Shift: faster"),
)


class ShortcutSheet:
    """Everything that has a key, menu by menu."""

    names: tuple[str, ...] = ("shortcuts",)

    def ask(self, ui: Ui, name: str) -> None:
        """Open it."""
        imgui.open_popup(TITLE)

    def draw(self, ui: Ui) -> None:
        """One frame."""
        centered(ImVec2(820, 0))
        if not imgui.begin_popup_modal(TITLE, None, imgui.WindowFlags_.no_saved_settings)[0]:
            return
        if imgui.begin_table("##sheet", 2, imgui.TableFlags_.sizing_stretch_same):
            imgui.table_next_column()
            for menu in ("File", "Edit", "Select", "Tools"):
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
