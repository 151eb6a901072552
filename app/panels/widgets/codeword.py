"""Codewords as rows of small squares, one per bit, bit 0 at the left."""

from __future__ import annotations

from imgui_bundle import ImVec2, imgui

from instdrive_app.language.translation import translate
from instdrive_app.panels.widgets.theme import pack_color, rgba
from instdrive_app.preferences.themes import ACCENT, DIM, HOVER


def draw_bit_squares(codeword: int, bits: int, size: float, gap: float) -> None:
    """Draw a codeword's bits, set ones filled, wrapped to the width at hand; the tooltip shows the number."""
    at, draw = imgui.get_cursor_screen_pos(), imgui.get_window_draw_list()
    pitch = size + gap
    per_row = max(int((imgui.get_content_region_avail().x + gap) / pitch), 1)
    on, off = pack_color(ACCENT), pack_color(HOVER)
    for bit in range(bits):
        x, y = at.x + (bit % per_row) * pitch, at.y + (bit // per_row) * pitch
        draw.add_rect_filled(ImVec2(x, y), ImVec2(x + size, y + size), on if codeword >> bit & 1 else off, size / 5)
    imgui.dummy(ImVec2(min(bits, per_row) * pitch - gap, (1 + (bits - 1) // per_row) * pitch - gap))
    if imgui.is_item_hovered():
        imgui.begin_tooltip()
        imgui.text(translate("Codeword {codeword}", codeword=codeword))
        imgui.text("".join(str(codeword >> bit & 1) for bit in range(bits)))
        imgui.text_colored(rgba(DIM), "bit 0 first")
        imgui.end_tooltip()
