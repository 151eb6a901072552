"""The sheet of keyboard shortcuts and mouse gestures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from imgui_bundle import ImVec2, imgui

from instdrive_app.action import format_shortcut
from instdrive_app.language.translation import make_label, translate
from instdrive_app.panels.dialogs.frame import BUTTON_WIDTH, center_next_window, is_enter_pressed
from instdrive_app.panels.menus import format_action_title
from instdrive_app.panels.widgets.ui import Ui, draw_dim_text, scale_pixels
from instdrive_app.session.requests import ShowShortcuts

TITLE = "Keys and mouse"
MOUSE = (
    ("Click", "Select; after a moment click again for what is behind"),
    ("Double click", "Select and frame"),
    ("Alt + wheel", "Go to what is behind, and back"),
    ("Shift + click", "Add to the selection"),
    ("Ctrl + click", "Remove from the selection"),
    ("Alt + click", "Select the whole codeword"),
    ("Shift + Ctrl", "With a region: keep only what is inside"),
    ("Right click", "Menu"),
    ("Left drag", "Orbit around the point under the cursor; region tools: select"),
    ("Right drag", "Look around; region tools: orbit"),
    ("Middle, Shift + drag", "Pan"),
    ("Wheel", "Move closer or away"),
    ("W A S D, Q E", "Fly; faster with Shift"),
    ("Up, Down, Home, End", "In the list: go to a row; Shift extends the selection"),
)
KEYS_EM = 9.5
"""Width of the keys, in font sizes."""
COLUMNS = 3


@dataclass(frozen=True)
class ShortcutGroup:
    """The shortcuts under one heading."""

    title: str
    rows: tuple[tuple[str, str], ...]
    """Keys, and what they do."""


class ShortcutSheet:
    """Lists every action that has a shortcut, menu by menu, and the mouse gestures."""

    def open(self, ui: Ui, request: ShowShortcuts) -> None:
        """Open it."""
        imgui.open_popup(make_label(TITLE))

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        center_next_window(ImVec2(76 * imgui.get_font_size(), 0), always=True)
        if not imgui.begin_popup_modal(make_label(TITLE), None, imgui.WindowFlags_.no_saved_settings)[0]:
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
        closed = imgui.button(make_label("Close"), ImVec2(width, 0))
        ui.mark("dialog.cancel")
        if closed or is_enter_pressed() or imgui.is_key_pressed(imgui.Key.escape):
            imgui.close_current_popup()
        imgui.end_popup()

    def _draw_sheet(self, ui: Ui) -> None:
        if not imgui.begin_table("##sheet", COLUMNS, imgui.TableFlags_.sizing_stretch_same):
            return
        for column in balance_columns(_collect_groups(ui), COLUMNS):
            imgui.table_next_column()
            for group in column:
                _draw_group(ui, group)
        imgui.end_table()


def balance_columns(groups: Sequence[ShortcutGroup], columns: int) -> list[list[ShortcutGroup]]:
    """Distribute groups over columns, in order, so that the longest column is as short as possible."""
    heights = [len(group.rows) + 2 for group in groups]
    limit = max(heights, default=0)
    while True:
        filled: list[list[ShortcutGroup]] = [[]]
        height_so_far = 0
        for group, height in zip(groups, heights, strict=True):
            if height_so_far and height_so_far + height > limit:
                filled.append([])
                height_so_far = 0
            filled[-1].append(group)
            height_so_far += height
        if len(filled) <= columns:
            return filled
        limit += 1


def _collect_groups(ui: Ui) -> list[ShortcutGroup]:
    commands = ui.session.actions
    found = []
    for menu in commands.menus:
        rows = [
            (", ".join(map(format_shortcut, command.shortcuts)), format_action_title(command))
            for command in commands.in_menu(menu)
            if command.shortcuts
        ]
        found.append(ShortcutGroup(menu, tuple(rows)))
    return [*(group for group in found if group.rows), ShortcutGroup("Mouse", MOUSE)]


def _draw_group(ui: Ui, group: ShortcutGroup) -> None:
    imgui.push_font(ui.fonts.bold, 0.0)
    imgui.text(translate(group.title))
    imgui.pop_font()
    for key, action in group.rows:
        text, width = translate(key), imgui.get_font_size() * KEYS_EM
        fits = imgui.calc_text_size(text).x < width - scale_pixels(4)
        draw_dim_text(text if fits else text.replace(", ", ",\n"))
        imgui.same_line(width)
        imgui.text_wrapped(translate(action))
    imgui.spacing()
