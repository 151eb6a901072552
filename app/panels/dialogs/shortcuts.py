"""The sheet of keys and mouse moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from imgui_bundle import ImVec2, imgui

from instdrive_app.action import format_shortcut
from instdrive_app.panels.dialogs.frame import BUTTON_WIDTH, center_next_window, is_enter_pressed
from instdrive_app.panels.menus import format_title
from instdrive_app.panels.widgets.ui import Ui, draw_dim_text, scale_pixels

TITLE = "Keys and mouse"
MOUSE = (
    ("Click", "Select; again there: the one behind"),
    ("Shift + click", "Add to the selection"),
    ("Ctrl + click", "Remove from the selection"),
    ("Alt + click", "Select the whole codeword"),
    ("Shift + Ctrl", "With a region: keep what is inside"),
    ("Right click", "Menu"),
    ("Left drag", "Orbit around what is under the cursor; region tools: select"),
    ("Right drag", "Look around; region tools: orbit"),
    ("Middle, Shift + drag", "Pan"),
    ("Wheel", "Nearer, farther"),
    ("W A S D, Q E", "Fly; with Shift: faster"),
    ("Up, Down, Home, End", "In the list: go to a row; Shift extends"),
)
COLUMNS = 3


@dataclass(frozen=True)
class ShortcutGroup:
    """What is listed under one heading."""

    title: str
    rows: tuple[tuple[str, str], ...]
    """Keys and what they do."""


class ShortcutSheet:
    """Everything that has a key, menu by menu."""

    names: tuple[str, ...] = ("shortcuts",)

    def ask(self, ui: Ui, name: str) -> None:
        """Open it."""
        imgui.open_popup(TITLE)

    def draw(self, ui: Ui) -> None:
        """One frame."""
        center_next_window(ImVec2(76 * imgui.get_font_size(), 0), always=True)
        if not imgui.begin_popup_modal(TITLE, None, imgui.WindowFlags_.no_saved_settings)[0]:
            return
        style = imgui.get_style()
        # Title and button stay in place where the rest scrolls.
        below = 2 * (imgui.get_frame_height_with_spacing() + style.window_padding.y + scale_pixels(12))
        imgui.set_next_window_size_constraints(ImVec2(0, 0), ImVec2(1e6, imgui.get_main_viewport().size.y - below))
        if imgui.begin_child("##sections", ImVec2(0, 0), imgui.ChildFlags_.auto_resize_y):
            self._draw_sheet(ui)
        imgui.end_child()
        width, padding = scale_pixels(BUTTON_WIDTH), imgui.get_style().window_padding.x
        imgui.set_cursor_pos_x(imgui.get_window_width() - width - padding)
        closed = imgui.button("Close", ImVec2(width, 0))
        ui.mark("dialog.cancel")
        if closed or is_enter_pressed() or imgui.is_key_pressed(imgui.Key.escape):
            imgui.close_current_popup()
        imgui.end_popup()

    def _draw_sheet(self, ui: Ui) -> None:
        if not imgui.begin_table("##sheet", COLUMNS, imgui.TableFlags_.sizing_stretch_same):
            return
        for column in balance_columns(_collect_groups(ui), COLUMNS):
            imgui.table_next_column()
            for section in column:
                _draw_group(ui, section)
        imgui.end_table()


def balance_columns(sections: Sequence[ShortcutGroup], columns: int) -> list[list[ShortcutGroup]]:
    """The sections in order, parted so that the longest column is as short as it can be."""
    heights = [len(section.rows) + 2 for section in sections]
    limit = max(heights, default=0)
    while True:
        parted: list[list[ShortcutGroup]] = [[]]
        filled = 0
        for section, height in zip(sections, heights, strict=True):
            if filled and filled + height > limit:
                parted.append([])
                filled = 0
            parted[-1].append(section)
            filled += height
        if len(parted) <= columns:
            return parted
        limit += 1


def _collect_groups(ui: Ui) -> list[ShortcutGroup]:
    commands = ui.session.actions
    found = []
    for menu in commands.menus:
        rows = [
            (", ".join(map(format_shortcut, command.shortcuts)), format_title(command))
            for command in commands.in_menu(menu)
            if command.shortcuts
        ]
        found.append(ShortcutGroup(menu, tuple(rows)))
    return [*(section for section in found if section.rows), ShortcutGroup("Mouse", MOUSE)]


def _draw_group(ui: Ui, section: ShortcutGroup) -> None:
    imgui.push_font(ui.fonts.bold, 0.0)
    imgui.text(section.title)
    imgui.pop_font()
    for key, action in section.rows:
        draw_dim_text(key)
        imgui.same_line(imgui.get_font_size() * 9.5)
        imgui.text_wrapped(action)
    imgui.spacing()
