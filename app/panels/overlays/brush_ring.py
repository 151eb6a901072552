"""The ring of a brush, and the trail that it has painted."""

from __future__ import annotations

from imgui_bundle import ImVec2, imgui

from instdrive_app.panels.widgets.theme import pack_color
from instdrive_app.panels.widgets.ui import Rectangle, Ui, scale_pixels
from instdrive_app.preferences.themes import PICTURE_ACCENT, PICTURE_SHADE, PICTURE_TEXT


class BrushRing:
    """Draws the ring at the pointer with the brush's depth limit, and the trail while it paints."""

    def draw(self, ui: Ui, place: Rectangle) -> None:
        """Draw one frame."""
        radius, draw, mouse = ui.tool.ring, imgui.get_window_draw_list(), imgui.get_io().mouse_pos
        if not radius or (ui.pointer is None and not ui.tool.trail):
            return
        radius /= place.density
        draw.push_clip_rect(ImVec2(place.x, place.y), ImVec2(place.x + place.width, place.y + place.height), True)
        if ui.tool.trail:
            points: list[imgui.ImVec2Like] = [ImVec2(*place.locate_pixel(x, y)) for x, y in ui.tool.trail]
            draw.add_polyline(points, pack_color(PICTURE_ACCENT, 0.3), 2 * radius, 0)
        draw.add_circle(mouse, radius, pack_color(PICTURE_SHADE, 0.85), 0, scale_pixels(3))
        draw.add_circle(mouse, radius, pack_color(PICTURE_TEXT), 0, scale_pixels(1.3))
        text = f"{ui.session.state.brush_depth:.3g} m deep"
        draw.add_text(ImVec2(mouse.x + radius + scale_pixels(6), mouse.y), pack_color(PICTURE_TEXT), text)
        draw.pop_clip_rect()
