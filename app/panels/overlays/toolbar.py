"""The toolbar at the picture's left edge, with the options of the current tool."""

from __future__ import annotations

from collections.abc import Iterable

from imgui_bundle import ImVec2, imgui

from instdrive_app.action import Action, format_shortcut
from instdrive_app.panels.widgets.theme import ACCENT, BACKGROUND, TEXT, pack_color, rgba
from instdrive_app.panels.widgets.ui import Rectangle, Ui, get_icon, scale_pixels

MARGIN = 10.0
"""Distance between the picture's edge and the bar; like the other lengths in pixels at scale 1."""
GAP = 2.0
GROUP_GAP = 8.0
PADDING = 3.0
BUTTON = 2.1
"""Side of a button, in font sizes."""


class Toolbar:
    """Draws a column of tools below the view switch, and beside the current tool a row with its options."""

    def draw(self, ui: Ui, place: Rectangle) -> None:
        """Draw one frame."""
        side = round(imgui.get_font_size() * BUTTON)
        left, top = place.x + scale_pixels(MARGIN), place.y + scale_pixels(2 * MARGIN) + imgui.get_frame_height()
        commands = {name: ui.session.actions[f"tool.{name}"] for name in ui.tools}
        tops = _compute_tops(commands.values(), side)
        _draw_plate(left, top, side, tops[-1] + side)
        for (name, command), offset in zip(commands.items(), tops, strict=True):
            _draw_tool_button(ui, command, ImVec2(left, top + offset), side)
            if name == ui.session.state.tool and ui.tool.options:
                _draw_options(ui, left + side + scale_pixels(2 * PADDING + MARGIN / 2), top + offset, side)


def _compute_tops(commands: Iterable[Action], side: float) -> list[float]:
    """Compute each tool's distance below the first, in pixels; a gap separates the groups."""
    tops, top = [], 0.0
    for command in commands:
        top += scale_pixels(GROUP_GAP) if command.separator else 0.0
        tops.append(top)
        top += side + scale_pixels(GAP)
    return tops


def _draw_options(ui: Ui, left: float, top: float, side: float) -> None:
    step, names = side + scale_pixels(GAP), ui.tool.options
    _draw_plate(left, top, len(names) * step - scale_pixels(GAP), side)
    for number, name in enumerate(names):
        _draw_tool_button(ui, ui.session.actions[name], ImVec2(left + number * step, top), side)


def _draw_plate(left: float, top: float, width: float, height: float) -> None:
    """Draw the plate behind buttons, which makes them visible on any picture."""
    edges = scale_pixels(2 * PADDING)
    low, high = ImVec2(left, top), ImVec2(left + width + edges, top + height + edges)
    imgui.get_window_draw_list().add_rect_filled(low, high, pack_color(BACKGROUND, 0.78), scale_pixels(6))


def _draw_tool_button(ui: Ui, command: Action, corner: ImVec2, side: float) -> None:
    """Draw an icon button, filled with the accent colour if the action is on; `corner` is the plate's top left."""
    imgui.set_cursor_screen_pos(ImVec2(corner.x + scale_pixels(PADDING), corner.y + scale_pixels(PADDING)))
    on = command.checked is not None and command.checked()
    imgui.push_style_color(imgui.Col_.button, rgba(ACCENT, 0.95) if on else rgba(BACKGROUND, 0.0))
    if on:
        imgui.push_style_color(imgui.Col_.button_hovered, rgba(ACCENT))
    imgui.push_style_color(imgui.Col_.text, rgba(BACKGROUND if on else TEXT))
    imgui.push_style_var(imgui.StyleVar_.frame_padding, ImVec2(0, 0))
    if imgui.button(f"{get_icon(command.icon)}##{command.id}", ImVec2(side, side)):
        ui.session.actions.run(command.id)
    imgui.pop_style_var()
    imgui.pop_style_color(3 if on else 2)
    ui.mark(command.id)
    if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
        keys = f"  ({format_shortcut(command.shortcuts[0])})" if command.shortcuts else ""
        imgui.set_tooltip(f"{command.title}{keys}")
