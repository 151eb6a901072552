"""A label beside the cursor for the instance under it."""

from __future__ import annotations

from imgui_bundle import ImVec2, imgui

from instdrive_app.language.translation import translate
from instdrive_app.panels.widgets.theme import rgba
from instdrive_app.panels.widgets.ui import Rectangle, Ui, draw_swatch, fit_text, scale_pixels
from instdrive_app.preferences.themes import BACKGROUND, DIM
from instdrive_core.wording import format_count

WIDEST = 320.0
"""Longest line shown, in pixels at scale 1."""
BOLD = 1.1
"""How much wider bold letters are, at most."""


class HoverLabel:
    """Shows name, class, number and size of the hovered instance."""

    def draw(self, ui: Ui, place: Rectangle) -> None:
        """Draw one frame."""
        document = ui.session.document
        if ui.session.state.stack is not None:
            return  # the list of what lies here stands in its place
        if document is None or ui.pointer is None or ui.session.state.hovered not in document.scene.table:
            return
        x, y = place.locate_pixel(*ui.pointer)
        instance = document.scene.table[ui.session.state.hovered]
        facts = [instance.class_name] if instance.class_name else []
        facts.append(f"#{instance.id}")
        facts.append(translate(format_count(document.summarize_instance(instance.id).drawn, "splat")))
        widest = min(scale_pixels(WIDEST), place.width - scale_pixels(60))
        text = fit_text("  ·  ".join(facts), widest)
        name = fit_text(instance.name, widest / BOLD)
        line, gap = imgui.get_text_line_height_with_spacing(), scale_pixels(18)
        width = max(imgui.calc_text_size(text).x, imgui.calc_text_size(name).x * BOLD + 2 * line) + scale_pixels(24)
        margin = scale_pixels(6)
        left = min(x + gap, place.x + place.width - width - margin)
        height = 2 * line + scale_pixels(20)
        top = y + gap if y + gap + height < place.y + place.height else y - gap - height + scale_pixels(10)
        imgui.set_next_window_pos(ImVec2(max(left, place.x + margin), max(top, place.y + margin)))
        flags = imgui.WindowFlags_
        passive = flags.no_inputs | flags.no_decoration | flags.always_auto_resize | flags.no_saved_settings
        imgui.push_style_color(imgui.Col_.window_bg, rgba(BACKGROUND, 0.92))
        imgui.begin("##hover label", None, passive | flags.no_docking | flags.no_focus_on_appearing | flags.no_nav)
        draw_swatch(ui, instance)
        imgui.same_line()
        imgui.push_font(ui.fonts.bold, 0.0)
        imgui.text(name)
        imgui.pop_font()
        imgui.text_colored(rgba(DIM), text)
        size, corner = imgui.get_window_size(), imgui.get_window_pos()
        ui.marks["hover label"] = (corner.x, corner.y, corner.x + size.x, corner.y + size.y)
        imgui.end()
        imgui.pop_style_color()
