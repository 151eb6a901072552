"""The tools at the picture's left edge, and the options of the one in the user's hand."""

from __future__ import annotations

from imgui_bundle import ImVec2, imgui

from instdrive_app.actions.tools import REGION_OPTIONS
from instdrive_app.commands import Command
from instdrive_app.panels.menus import shortcut_title
from instdrive_app.panels.ui import Rectangle, Ui, icon
from instdrive_app.theme import ACCENT, BACKGROUND, TEXT, packed, rgba
from instdrive_app.tools.registry import TOOLS

MARGIN = 10.0
"""Pixels between the picture's edge and the bar."""
GAP = 2.0
PADDING = 3.0
BUTTON = 2.1
"""Side of a button over the font's size."""


class Toolbar:
    """A column of tools under the view switch; beside a region tool the row of its options."""

    holds_mouse: bool = False

    def draw(self, ui: Ui, place: Rectangle) -> None:
        """One frame."""
        side = round(imgui.get_font_size() * BUTTON)
        left = place.x + MARGIN
        top = place.y + 2 * MARGIN + imgui.get_frame_height()
        commands = ui.session.commands
        _strip(ui, [commands[f"tool.{record.name}"] for record in TOOLS], ImVec2(left, top), ImVec2(0, side + GAP))
        for number, record in enumerate(TOOLS):
            if record.name == ui.session.state.tool and record.selects_regions:
                beside = ImVec2(left + side + 2 * PADDING + MARGIN / 2, top + number * (side + GAP))
                _strip(ui, [commands[name] for name in REGION_OPTIONS], beside, ImVec2(side + GAP, 0))


def _strip(ui: Ui, commands: list[Command], corner: ImVec2, step: ImVec2) -> None:
    """Buttons from `corner` on, each `step` pixels from the last, on a plate of their own."""
    side = round(imgui.get_font_size() * BUTTON)
    last = len(commands) - 1
    end = ImVec2(corner.x + last * step.x + side + 2 * PADDING, corner.y + last * step.y + side + 2 * PADDING)
    imgui.get_window_draw_list().add_rect_filled(corner, end, packed(BACKGROUND, 0.78), 6)
    for number, command in enumerate(commands):
        at = ImVec2(corner.x + PADDING + number * step.x, corner.y + PADDING + number * step.y)
        imgui.set_cursor_screen_pos(at)
        _tool_button(ui, command, ImVec2(side, side))


def _tool_button(ui: Ui, command: Command, size: ImVec2) -> None:
    """An icon, filled with the accent's colour where the command is on."""
    on = command.checked is not None and command.checked()
    imgui.push_style_color(imgui.Col_.button, rgba(ACCENT, 0.95) if on else rgba(BACKGROUND, 0.0))
    if on:
        imgui.push_style_color(imgui.Col_.button_hovered, rgba(ACCENT))
    imgui.push_style_color(imgui.Col_.text, rgba(BACKGROUND if on else TEXT))
    imgui.push_style_var(imgui.StyleVar_.frame_padding, ImVec2(0, 0))
    if imgui.button(f"{icon(command.icon)}##{command.id}", size):
        ui.session.commands.run(command.id)
    imgui.pop_style_var()
    imgui.pop_style_color(3 if on else 2)
    ui.mark(command.id)
    if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
        keys = f"  ({shortcut_title(command.shortcuts[0])})" if command.shortcuts else ""
        imgui.set_tooltip(f"{command.title}{keys}")
