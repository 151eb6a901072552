"""The toolbar at the picture's left edge, with the options of the current tool."""

from __future__ import annotations

from collections.abc import Sequence

from imgui_bundle import ImVec2, imgui

from instdrive_app.action import Action, format_shortcut
from instdrive_app.actions.conditions import explain_disabled, run_or_explain
from instdrive_app.language.translation import translate
from instdrive_app.panels.widgets.theme import pack_color, pop_accent_fill, push_accent_fill, push_plate_fill
from instdrive_app.panels.widgets.ui import Rectangle, Ui, get_icon, scale_pixels
from instdrive_app.preferences.themes import BACKGROUND, DIM, TEXT

MARGIN = 10.0
"""Distance between the picture's edge and the bar; like the other lengths in pixels at scale 1."""
GAP = 2.0
GROUP_GAP = 8.0
PADDING = 3.0
BUTTON = 2.1
"""Side of a button, in font sizes."""
LEGEND = 50.0
"""Room at the bottom for what views other than colour show there."""
LOW = 360.0
"""Height up to which a picture has no such room to spare."""
FEW = 7
"""Options that stand beside their tool; more stand at the top, out of the way of what is worked on."""


class Toolbar:
    """Draws the tools below the view switch, in as many columns as the picture's height asks for.

    Beside them, a row has the options of the current tool.
    """

    def draw(self, ui: Ui, place: Rectangle) -> None:
        """Draw one frame."""
        side = round(imgui.get_font_size() * BUTTON)
        left, top = place.x + scale_pixels(MARGIN), place.y + scale_pixels(2 * MARGIN) + imgui.get_frame_height()
        commands = {name: ui.session.actions[f"tool.{name}"] for name in ui.tools}
        reserve = LEGEND if place.height > scale_pixels(LOW) else 0.0
        height = place.y + place.height - top - scale_pixels(MARGIN + reserve)
        columns = _arrange_columns(tuple(commands.values()), side, height)
        tops = {command.id: (number, at) for number, column in enumerate(columns) for command, at in column}
        step = side + scale_pixels(2 * PADDING + MARGIN / 2)
        for number, column in enumerate(columns):
            _draw_plate(left + number * step, top, side, column[-1][1] + side)
        for name, command in commands.items():
            number, offset = tops[command.id]
            _draw_tool_button(ui, command, ImVec2(left + number * step, top + offset), side)
            if name == ui.session.state.tool and ui.tool.options:
                room = place.x + place.width - scale_pixels(MARGIN) - left - len(columns) * step
                at = ImVec2(left + len(columns) * step, top + (offset if len(ui.tool.options) <= FEW else 0.0))
                _draw_options(ui, at, side, room, top + height)


def _arrange_columns(commands: Sequence[Action], side: float, height: float) -> list[list[tuple[Action, float]]]:
    """Arrange tools in columns of at most this height (pixels): each with its distance below the column's top.

    A gap separates groups; a group that no longer fits below the one before begins a column.
    """
    columns: list[list[tuple[Action, float]]] = [[]]
    top, step = 0.0, side + scale_pixels(GAP)
    for number, command in enumerate(commands):
        if command.separator and columns[-1]:
            following = (place for place, other in enumerate(commands) if place > number and other.separator)
            group = (next(following, len(commands)) - number) * step
            top = height if top + scale_pixels(GROUP_GAP) + group > height >= group else top + scale_pixels(GROUP_GAP)
        if columns[-1] and top + side > height:
            columns.append([])
            top = 0.0
        columns[-1].append((command, top))
        top += step
    return columns


def _draw_options(ui: Ui, corner: ImVec2, side: float, room: float, bottom: float) -> None:
    """Draw the options from `corner` on, in as many rows as the room to the right asks for, above `bottom`."""
    step, names = side + scale_pixels(GAP), ui.tool.options
    columns = max(min(len(names), int((room - scale_pixels(2 * PADDING)) / step)), 1)
    rows = -(-len(names) // columns)
    height = rows * step - scale_pixels(GAP)
    top = min(corner.y, bottom - height - scale_pixels(2 * PADDING))
    _draw_plate(corner.x, top, columns * step - scale_pixels(GAP), height)
    for number, name in enumerate(names):
        row, column = divmod(number, columns)
        at = ImVec2(corner.x + column * step, top + row * step)
        _draw_tool_button(ui, ui.session.actions[name], at, side)


def _draw_plate(left: float, top: float, width: float, height: float) -> None:
    """Draw the plate behind buttons, which makes them visible on any picture."""
    edges = scale_pixels(2 * PADDING)
    low, high = ImVec2(left, top), ImVec2(left + width + edges, top + height + edges)
    imgui.get_window_draw_list().add_rect_filled(low, high, pack_color(BACKGROUND, 0.78), scale_pixels(6))


def _draw_tool_button(ui: Ui, command: Action, corner: ImVec2, side: float) -> None:
    """Draw an icon button, filled with the accent colour if the action is on; `corner` is the plate's top left."""
    imgui.set_cursor_screen_pos(ImVec2(corner.x + scale_pixels(PADDING), corner.y + scale_pixels(PADDING)))
    on = command.checked is not None and command.checked()
    enabled = command.enabled()
    push_accent_fill() if on else push_plate_fill(0.0, TEXT if enabled else DIM)
    imgui.push_style_var(imgui.StyleVar_.frame_padding, ImVec2(0, 0))
    if imgui.button(f"{get_icon(command.icon)}##{command.id}", ImVec2(side, side)):
        run_or_explain(ui.session, command)
    imgui.pop_style_var()
    pop_accent_fill()
    ui.mark(command.id)
    if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
        keys = f"  ({format_shortcut(command.shortcuts[0])})" if command.shortcuts else ""
        reason = "" if enabled else f"\n{translate(explain_disabled(ui.session, command))}"
        imgui.set_tooltip(f"{translate(command.title)}{keys}{reason}")
