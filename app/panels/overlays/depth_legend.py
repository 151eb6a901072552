"""The colour scale of the depth view."""

from __future__ import annotations

import math
from itertools import pairwise

from imgui_bundle import ImVec2, imgui

from instdrive_app.panels.widgets.theme import pack_color
from instdrive_app.panels.widgets.ui import Rectangle, Ui, scale_pixels
from instdrive_app.preferences.themes import BACKGROUND, TEXT
from instdrive_app.render.picture_colors import DEPTH_RAMP
from instdrive_app.state import ViewMode


class DepthLegend:
    """Draws the colour ramp with metres at its ends and in the middle."""

    def draw(self, ui: Ui, place: Rectangle) -> None:
        """Draw one frame."""
        if ui.session.state.view_mode is not ViewMode.DEPTH or ui.session.document is None:
            return
        near, far = ui.view.renderer.depth_range
        width, height = min(scale_pixels(220), place.width - scale_pixels(32)), scale_pixels(10)
        left, top = place.x + scale_pixels(20), place.y + place.height - scale_pixels(44)
        draw = imgui.get_window_draw_list()
        draw.add_rect_filled(
            ImVec2(left - scale_pixels(10), top - scale_pixels(8)),
            ImVec2(left + width + scale_pixels(10), top + scale_pixels(34)),
            pack_color(BACKGROUND, 0.78),
            scale_pixels(4),
        )
        ui.marks["viewport.legend"] = (
            left - scale_pixels(10),
            top - scale_pixels(8),
            left + width + scale_pixels(10),
            top + scale_pixels(34),
        )
        part = width / (len(DEPTH_RAMP) - 1)
        for number, (first, second) in enumerate(pairwise(DEPTH_RAMP)):
            low, high = ImVec2(left + number * part, top), ImVec2(left + (number + 1) * part, top + height)
            a, b = pack_color(first), pack_color(second)
            draw.add_rect_filled_multi_color(low, high, a, b, b, a)
        for place_on_ramp in (0.0, 0.5, 1.0):
            label = f"{near * math.pow(far / near, place_on_ramp):.3g} m"
            shift = imgui.calc_text_size(label).x * place_on_ramp
            draw.add_text(
                ImVec2(left + width * place_on_ramp - shift, top + height + scale_pixels(3)), pack_color(TEXT), label
            )
