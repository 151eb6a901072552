"""The measured line with its length; Escape takes it away."""

from __future__ import annotations

from imgui_bundle import ImVec2, imgui

from instdrive_app.language.translation import translate
from instdrive_app.panels.overlays.world_pen import WorldPen
from instdrive_app.panels.widgets.theme import pack_color
from instdrive_app.panels.widgets.ui import Rectangle, Ui, scale_pixels
from instdrive_app.preferences.themes import PICTURE_ACCENT, PICTURE_SHADE, PICTURE_TEXT

DOT = 4.0
"""Radius of an end, pixels at scale 1."""
ESCAPE = frozenset({"Escape"})


class RulerOverlay:
    """Draws the ends, the line, the legs along the ground and upwards, and the lengths."""

    def draw(self, ui: Ui, place: Rectangle) -> None:
        """Draw one frame."""
        ruler, snapshot = ui.session.aids.ruler, ui.view.snapshot
        if not ruler.points or snapshot is None:
            return
        ui.claimed_shortcuts = ui.claimed_shortcuts | ESCAPE  # the line goes, the selection stays
        if imgui.is_key_pressed(imgui.Key.escape, False) and not ui.popup_open and not imgui.get_io().want_text_input:
            ruler.clear()
            return
        draw, pen = imgui.get_window_draw_list(), WorldPen(snapshot.camera, place, 2.0)
        draw.push_clip_rect(ImVec2(place.x, place.y), ImVec2(place.x + place.width, place.y + place.height), True)
        if len(ruler.points) == 2:
            start, end = ruler.points
            corner = end.copy()
            corner[2] = start[2]
            pen.draw_dashes(start, corner, pack_color(PICTURE_TEXT, 0.6))
            pen.draw_dashes(corner, end, pack_color(PICTURE_TEXT, 0.6))
            pen.draw_line(start, end, pack_color(PICTURE_ACCENT))
            self._draw_label(ui, pen, place)
        for point in ruler.points:
            pixel = pen.project(point)
            if pixel is not None:
                draw.add_circle_filled(ImVec2(*pixel), scale_pixels(DOT + 1.5), pack_color(PICTURE_SHADE, 0.8))
                draw.add_circle_filled(ImVec2(*pixel), scale_pixels(DOT), pack_color(PICTURE_ACCENT))
        draw.pop_clip_rect()

    def _draw_label(self, ui: Ui, pen: WorldPen, place: Rectangle) -> None:
        """Write the lengths beside the middle of the line, inside the picture."""
        ruler, draw = ui.session.aids.ruler, imgui.get_window_draw_list()
        middle = pen.project((ruler.points[0] + ruler.points[1]) / 2)
        if middle is None:
            return
        text, pad = translate(ruler.describe()), scale_pixels(6)
        size = imgui.calc_text_size(text)
        left = min(max(middle[0] - size.x / 2, place.x + pad), place.x + place.width - size.x - 2 * pad)
        top = min(max(middle[1] - 2.2 * size.y, place.y + pad), place.y + place.height - size.y - 2 * pad)
        low, high = ImVec2(left - pad, top - pad / 2), ImVec2(left + size.x + pad, top + size.y + pad / 2)
        draw.add_rect_filled(low, high, pack_color(PICTURE_SHADE, 0.85), scale_pixels(4))
        draw.add_text(ImVec2(left, top), pack_color(PICTURE_TEXT), text)
        ui.marks["gizmo.ruler"] = (low.x, low.y, high.x, high.y)
