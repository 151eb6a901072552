"""The list of what lies behind each other under the pointer, after a slow second click or Alt + wheel."""

from __future__ import annotations

from imgui_bundle import ImVec2, imgui

from instdrive_app.panels.widgets.theme import rgba
from instdrive_app.panels.widgets.ui import Rectangle, Ui, draw_swatch, fit_text, scale_pixels
from instdrive_app.preferences.themes import BACKGROUND
from instdrive_app.state import Stack

WIDEST = 240.0
"""Width of a line; like the other lengths in pixels at scale 1."""
GAP, REACH = 18.0, 30.0
"""Distance of the list from the place, and of the pointer from both before the list closes."""
MOST_LINES = 8
"""Instances that are listed; there may be more behind."""


class StackList:
    """Names the candidates, front to back; a click on one selects it."""

    def draw(self, ui: Ui, place: Rectangle) -> None:
        """Draw one frame."""
        stack, document, snapshot = ui.session.state.stack, ui.session.document, ui.view.snapshot
        if stack is None or document is None:
            return
        ids = tuple(number for number in stack.ids if number in document.scene.table)
        turned = snapshot is not None and snapshot.camera.world_from_camera.tobytes() != stack.pose
        if turned or ids != stack.ids or ui.session.selection.ids != (stack.ids[stack.chosen],):
            ui.session.state.stack = None
            return
        shown, lines = _choose_lines(stack), min(len(ids), MOST_LINES)
        line, padding = imgui.get_text_line_height_with_spacing(), imgui.get_style().window_padding
        width, height = scale_pixels(WIDEST), lines * line + 2 * padding.y
        x, y = place.locate_pixel(*stack.place)
        left = max(min(x + scale_pixels(GAP), place.x + place.width - width - 6), place.x + 6.0)
        top = max(min(y + scale_pixels(GAP), place.y + place.height - height - 6), place.y + 6.0)
        imgui.set_next_window_pos(ImVec2(left, top))
        imgui.set_next_window_size(ImVec2(width, height))
        flags = imgui.WindowFlags_
        still = flags.no_decoration | flags.no_saved_settings | flags.no_docking | flags.no_focus_on_appearing
        imgui.push_style_color(imgui.Col_.window_bg, rgba(BACKGROUND, 0.95))
        imgui.begin("##what lies behind each other", None, still | flags.no_nav | flags.no_move)
        for number in shown:
            self._draw_line(ui, stack, number)
        low, size = imgui.get_window_pos(), imgui.get_window_size()
        ui.marks["stack"] = (low.x, low.y, low.x + size.x, low.y + size.y)
        imgui.end()
        imgui.pop_style_color()
        mouse, reach = imgui.get_io().mouse_pos, scale_pixels(REACH)
        near_place = abs(mouse.x - x) + abs(mouse.y - y) <= reach
        near_list = (
            low.x - reach <= mouse.x <= low.x + size.x + reach and low.y - reach <= mouse.y <= low.y + size.y + reach
        )
        if not (near_place or near_list) and ui.script_pointer is None:
            ui.session.state.stack = None

    def _draw_line(self, ui: Ui, stack: Stack, number: int) -> None:
        document = ui.session.document
        assert document is not None
        instance = document.scene.table[stack.ids[number]]
        draw_swatch(ui, instance)
        imgui.same_line()
        name = fit_text(instance.name, imgui.get_content_region_avail().x)
        if imgui.selectable(f"{name}##stack {instance.id}", number == stack.chosen)[0]:
            ui.session.selection.select((instance.id,), "replace")
            ui.session.state.stack = Stack(stack.ids, number, stack.place, stack.pose)
        ui.mark(f"stack.{instance.id}")


def _choose_lines(stack: Stack) -> range:
    """Choose the lines around the selected one that are listed."""
    first = min(max(stack.chosen - MOST_LINES + 1, 0), max(len(stack.ids) - MOST_LINES, 0))
    return range(first, min(first + MOST_LINES, len(stack.ids)))
