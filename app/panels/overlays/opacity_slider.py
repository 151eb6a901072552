"""A slider for the opacity that a splat needs to appear in the ID views."""

from __future__ import annotations

from imgui_bundle import ImVec2, imgui

from instdrive_app.language.translation import translate
from instdrive_app.panels.widgets.theme import rgba
from instdrive_app.panels.widgets.ui import Rectangle, Ui, draw_bounded_slider, scale_pixels
from instdrive_app.preferences.themes import BACKGROUND
from instdrive_app.state import SPLAT_MODES, ViewMode

SHOWN_IN = (ViewMode.INSTANCE, ViewMode.CODEWORD, *SPLAT_MODES)
"""View modes that leave faint splats out."""


class OpacitySlider:
    """Sets the opacity from which splats are drawn in the ID views and can be clicked."""

    def draw(self, ui: Ui, place: Rectangle) -> None:
        """Draw one frame."""
        if ui.session.document is None or ui.session.state.view_mode not in SHOWN_IN:
            return
        margin = scale_pixels(10)
        bottom = place.y + place.height - imgui.get_frame_height() - margin
        imgui.set_cursor_screen_pos(ImVec2(place.x + margin, bottom))
        imgui.set_next_item_width(scale_pixels(200))
        imgui.push_style_color(imgui.Col_.frame_bg, rgba(BACKGROUND, 0.85))
        state, form = ui.session.state, translate("Minimum opacity %.2f")
        _, state.id_opacity = draw_bounded_slider("##id opacity", state.id_opacity, 0.0, 0.95, form)
        imgui.pop_style_color()
        ui.mark("viewport.opacity")
        if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
            imgui.set_tooltip(translate("Fainter splats are left out of this view and cannot be clicked"))
