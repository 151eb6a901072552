"""The outline of the region that is being dragged."""

from __future__ import annotations

import numpy as np
from imgui_bundle import ImVec2, imgui
from jaxtyping import Float64
from numpy import ndarray

from instdrive_app.language.translation import translate
from instdrive_app.panels.widgets.theme import pack_color
from instdrive_app.panels.widgets.ui import Rectangle, Ui, scale_pixels
from instdrive_app.pointer import Point, choose_selection_mode
from instdrive_app.preferences.themes import PICTURE_SHADE, PICTURE_TEXT
from instdrive_core.wording import phrase

DASH = 5.0
"""Length of a dash, and of the gap after it, in pixels."""
PACE = 24.0
"""Speed of the marching dashes, in pixels per second."""
MODE_WORDS = {
    "replace": "",
    "add": phrase("add"),
    "remove": phrase("remove"),
    "intersect": phrase("keep only what is inside"),
}


class RegionOutline:
    """Draws a dark line with light dashes, visible on any picture, and what the modifier keys will do."""

    def draw(self, ui: Ui, place: Rectangle) -> None:
        """Draw one frame."""
        outline = tuple(place.locate_pixel(x, y) for x, y in ui.tool.outline)
        if len(outline) < 2:
            return
        draw = imgui.get_window_draw_list()
        corners: list[imgui.ImVec2Like] = [ImVec2(x, y) for x, y in outline]
        draw.push_clip_rect(ImVec2(place.x, place.y), ImVec2(place.x + place.width, place.y + place.height), True)
        draw.add_polyline(corners, pack_color(PICTURE_SHADE, 0.85), scale_pixels(2.5), imgui.ImDrawFlags_.closed)
        light = pack_color(PICTURE_TEXT)
        for x0, y0, x1, y1 in compute_dashes(outline, imgui.get_time() * PACE).tolist():
            draw.add_line(ImVec2(x0, y0), ImVec2(x1, y1), light, scale_pixels(1.2))
        draw.pop_clip_rect()
        _draw_mode()


def compute_dashes(outline: tuple[Point, ...], shift: float) -> Float64[ndarray, "d 4"]:
    """Compute the dashes along a closed line, moved on by `shift` pixels: start x, y and end x, y of each piece."""
    corners = np.array([*outline, outline[0]])
    lengths = np.hypot(*np.diff(corners, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    borders = np.arange(-DASH + shift % DASH, along[-1] + DASH, DASH)
    stops = np.unique(np.concatenate([along, borders.clip(0, along[-1])]))
    middles = (stops[1:] + stops[:-1]) / 2
    lit = np.floor((middles - shift) / DASH) % 2 == 0
    x, y = (np.interp(stops, along, corners[:, axis]) for axis in range(2))
    return np.stack([x[:-1], y[:-1], x[1:], y[1:]], axis=1)[lit]


def _draw_mode() -> None:
    io = imgui.get_io()
    word = translate(MODE_WORDS[choose_selection_mode(io.key_shift, io.key_ctrl)])
    if not word:
        return
    size, draw = imgui.calc_text_size(word), imgui.get_foreground_draw_list()
    left, top = io.mouse_pos.x + scale_pixels(16), io.mouse_pos.y + scale_pixels(12)
    draw.add_rect_filled(
        ImVec2(left - scale_pixels(6), top - scale_pixels(3)),
        ImVec2(left + size.x + scale_pixels(6), top + size.y + scale_pixels(3)),
        pack_color(PICTURE_SHADE, 0.85),
        scale_pixels(4),
    )
    draw.add_text(ImVec2(left, top), pack_color(PICTURE_TEXT), word)
