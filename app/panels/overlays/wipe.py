"""The line between photo and splats, which the mouse drags to and fro."""

from __future__ import annotations

from imgui_bundle import ImVec2, imgui

from instdrive_app.panels.widgets.theme import pack_color
from instdrive_app.panels.widgets.ui import Ui, get_icon, scale_pixels
from instdrive_app.preferences.themes import BACKGROUND, PICTURE_ACCENT, PICTURE_SHADE, TEXT

REACH = 7.0
"""Pixels at scale 1 to each side of the line where the mouse takes it."""
KNOB = 12.0
"""Radius of the knob in its middle, pixels at scale 1."""


class WipeLine:
    """Draws the line and moves it with the mouse."""

    def draw(self, ui: Ui, film: tuple[float, float, float, float], buttons: float) -> None:
        """Draw one frame; `film` is where the photo is in the window: left, top, right, bottom.

        Above `buttons` the mouse does not take the line: there are the view modes.
        """
        left, top, right, bottom = film
        state, reach = ui.session.state, scale_pixels(REACH)
        x = left + state.wipe * (right - left)
        begin = max(top, min(buttons, bottom - 1))
        imgui.set_cursor_screen_pos(ImVec2(x - reach, begin))
        imgui.set_next_item_allow_overlap()
        imgui.invisible_button("##wipe", ImVec2(2 * reach, max(bottom - begin, 1.0)))
        ui.mark("viewport.wipe")
        is_held = imgui.is_item_active()
        if is_held or imgui.is_item_hovered():
            imgui.set_mouse_cursor(imgui.MouseCursor_.resize_ew)
        if is_held:
            state.wipe = min(max((imgui.get_io().mouse_pos.x - left) / max(right - left, 1.0), 0.0), 1.0)
            x = left + state.wipe * (right - left)
        draw, color = imgui.get_window_draw_list(), pack_color(PICTURE_ACCENT)
        draw.add_line(ImVec2(x, top), ImVec2(x, bottom), pack_color(PICTURE_SHADE, 0.6), scale_pixels(4))
        draw.add_line(ImVec2(x, top), ImVec2(x, bottom), color, scale_pixels(1.5))
        middle = ImVec2(x, (top + bottom) / 2)
        draw.add_circle_filled(middle, scale_pixels(KNOB), pack_color(BACKGROUND, 0.9))
        draw.add_circle(middle, scale_pixels(KNOB), color, 0, scale_pixels(1.5))
        glyph = get_icon("ICON_FA_LEFT_RIGHT")
        size = imgui.calc_text_size(glyph)
        draw.add_text(ImVec2(middle.x - size.x / 2, middle.y - size.y / 2), pack_color(TEXT), glyph)
