"""Selecting by ranges of values, with a histogram, and finding floaters of the whole scene."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from imgui_bundle import ImVec2, imgui

from instdrive_app.language.translation import make_label, translate
from instdrive_app.panels.widgets.ui import (
    Ui,
    draw_action_button,
    draw_bounded_slider,
    draw_dim_text,
    make_icon_label,
    scale_pixels,
)
from instdrive_core.wording import phrase

FLOATER_SLIDERS = (
    ("isolation", "alone: %.1f × the usual gap", 0.0, 20.0),
    ("opacity", "fainter than %.3f", 0.0, 0.5),
    ("thickness", "thinner than %.4f m", 0.0, 0.05),
    ("elongation", "longer than %.0f widths", 0.0, 100.0),
)
"""Field of `FloaterLimits`, what the slider says, least and most."""


OFF = {
    "isolation": phrase("isolation: off"),
    "opacity": phrase("opacity: off"),
    "thickness": phrase("thickness: off"),
    "elongation": phrase("elongation: off"),
}
"""What a slider says that does not count."""


class FilterPanel:
    """Shows how a value is spread, selects a range of it while the sliders move, and finds floaters."""

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""
        document, chosen = ui.session.document, ui.session.filter
        if document is None:
            imgui.text_disabled(translate("No scene is open."))
            return
        imgui.set_next_item_width(-1)
        if imgui.begin_combo("##value", translate(chosen.value.title)):
            for value in chosen.choices:
                if imgui.selectable(make_label(value.title), value is chosen.value)[0]:
                    chosen.choose(value.name)
                ui.mark(f"filter.value.{value.name}")
            imgui.end_combo()
        ui.mark("filter.value")
        self._draw_range(ui)
        imgui.separator_text(translate("Floaters of the whole scene"))
        self._draw_floaters(ui)

    def _draw_range(self, ui: Ui) -> None:
        chosen = ui.session.filter
        least, most = chosen.find_limits()
        low, high = chosen.range
        bars = np.sqrt(chosen.count_bins().astype(np.float32))  # so that small bars can be seen beside large ones
        imgui.plot_histogram(
            "##histogram", bars, graph_size=ImVec2(imgui.get_content_region_avail().x, scale_pixels(70))
        )
        ui.mark("filter.histogram")
        flags = imgui.SliderFlags_.logarithmic if chosen.value.is_logarithmic and least > 0 else 0
        unit = f" {chosen.value.unit}" if chosen.value.unit else ""
        ends = []
        for name, end in ((phrase("from"), low), (phrase("to"), high)):
            imgui.set_next_item_width(-1)
            changed, end = draw_bounded_slider(f"##{name}", end, least, most, f"{translate(name)} %.4g{unit}", flags)
            ui.mark(f"filter.{name}")
            ends.append((changed, end))
        if ends[0][0] or ends[1][0]:
            chosen.select_range(min(ends[0][1], ends[1][1]), max(ends[0][1], ends[1][1]))

    def _draw_floaters(self, ui: Ui) -> None:
        chosen = ui.session.filter
        for field, form, low, high in FLOATER_SLIDERS:
            imgui.set_next_item_width(-1)
            value = getattr(chosen.limits, field)
            changed, value = draw_bounded_slider(
                f"##{field}", value, low, high, translate(form) if value else translate(OFF[field])
            )
            ui.mark(f"filter.{field}")
            if changed:
                chosen.limits = replace(chosen.limits, **{field: value})
        imgui.begin_disabled(ui.session.jobs.is_blocking)
        if imgui.button(make_icon_label("ICON_FA_WAND_MAGIC_SPARKLES", "Preview")):
            chosen.select_floaters()
        ui.mark("filter.floaters")
        imgui.end_disabled()
        imgui.same_line()
        draw_action_button(ui, ui.session.actions["edit.delete"])
        imgui.same_line()
        draw_dim_text(translate("selects what would go"))
