"""Sliders for hue, brightness, contrast and so on of the selected instances; drags take effect live."""

from __future__ import annotations

from math import isfinite
from typing import NamedTuple

from imgui_bundle import ImVec2, imgui

from instdrive_app.language.translation import translate
from instdrive_app.panels.widgets.gestures import Gesture
from instdrive_app.panels.widgets.theme import rgba
from instdrive_app.panels.widgets.ui import Ui, draw_dim_text, get_icon, make_icon_label, scale_pixels
from instdrive_app.preferences.themes import DIM, TEXT
from instdrive_app.session.versioned_cache import VersionedCache
from instdrive_core.edits.bases.adjustments import RANGES, AdjustKind
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.absolute_adjustment import AdjustmentSummary, summarize_adjustments
from instdrive_core.wording import phrase

Ids = tuple[int, ...]


class Slider(NamedTuple):
    """How an amount is shown: multiplied by `scale`, in the C format `form`, between `low` and `high`."""

    title: str
    form: str
    scale: float
    low: float
    high: float


SLIDERS: dict[AdjustKind, Slider] = {
    "hue": Slider("Hue", "%+.0f°", 1.0, -180.0, 180.0),
    "brightness": Slider("Brightness", "%.0f %%", 100.0, 0.0, 200.0),
    "contrast": Slider("Contrast", "%.0f %%", 100.0, 0.0, 200.0),
    "saturation": Slider("Saturation", "%.0f %%", 100.0, 0.0, 200.0),
    "temperature": Slider("Warmth", "%+.0f", 100.0, -100.0, 100.0),
    "opacity": Slider("Opacity", "%.0f %%", 100.0, 0.0, 100.0),
}
"""Dragging sets brightness, contrast and saturation to 200 % at most, typing (Ctrl + click) to 400 %."""
HINTS: dict[AdjustKind, str] = {
    "hue": "Rotates colours around the colour wheel; light and shade stay",
    "brightness": "Multiplies all colours",
    "contrast": "Spreads colours away from their mean",
    "saturation": "0 % is grey",
    "temperature": "Below 0 bluer, above 0 redder",
    "opacity": "Makes the splats see-through",
}


class AdjustSection:
    """Shows the adjustments that the instances have, so that the sliders follow undo and the selection."""

    title: str = "Adjustments"

    def __init__(self) -> None:
        self._gestures = {kind: Gesture(kind) for kind in SLIDERS}
        self._look: VersionedCache[AdjustmentSummary] = VersionedCache()

    def draw(self, ui: Ui, document: Document, ids: Ids) -> None:
        """Draw one frame."""
        look = self._find_look(document, ids)
        label = max(imgui.calc_text_size(translate(slider.title)).x for slider in SLIDERS.values()) + scale_pixels(10)
        for kind in SLIDERS:
            self._draw_slider(ui, kind, ids, look.amounts[kind], label)
        imgui.begin_disabled(not look.recolored)
        if imgui.button(make_icon_label("ICON_FA_ROTATE_LEFT", "Reset colours"), ImVec2(-1, 0)):
            ui.session.colors.reset(ids)
        imgui.end_disabled()
        ui.mark("inspector.reset_colors")
        if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
            imgui.set_tooltip(translate("Back to the trained colours and opacities"))

    def _draw_slider(self, ui: Ui, kind: AdjustKind, ids: Ids, amounts: tuple[float, ...], label: float) -> None:
        slider, neutral = SLIDERS[kind], RANGES[kind].neutral
        mixed = len(amounts) > 1
        amount = amounts[0] if len(amounts) == 1 else neutral
        imgui.align_text_to_frame_padding()
        draw_dim_text(translate(slider.title))
        imgui.same_line(imgui.get_cursor_start_pos().x + label)
        reset = imgui.get_frame_height()
        imgui.set_next_item_width(imgui.get_content_region_avail().x - reset - scale_pixels(4))
        form = translate("mixed") if mixed else slider.form
        changed, value = imgui.slider_float(f"##{kind}", amount * slider.scale, slider.low, slider.high, form)
        gesture = self._gestures[kind].name_drag()
        ui.mark(f"inspector.adjust.{kind}")
        if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
            imgui.set_tooltip(translate("{hint}. Ctrl + click to type", hint=phrase(HINTS[kind])))
        if changed and isfinite(value):
            low, high, _ = RANGES[kind]
            # A typed 130 % must become 1.3, not its neighbour in single precision.
            ui.session.colors.adjust(ids, kind, min(max(round(value / slider.scale, 4), low), high), gesture)
        imgui.same_line(0, scale_pixels(4))
        self._draw_reset(ui, kind, ids, mixed or abs(amount - neutral) > 1e-6)

    def _draw_reset(self, ui: Ui, kind: AdjustKind, ids: Ids, possible: bool) -> None:
        imgui.push_style_color(imgui.Col_.text, rgba(TEXT if possible else DIM, 1.0 if possible else 0.35))
        imgui.push_style_color(imgui.Col_.button, rgba(DIM, 0.0))
        size = imgui.get_frame_height()
        if imgui.button(f"{get_icon('ICON_FA_ROTATE_LEFT')}##{kind}", ImVec2(size, 0)) and possible:
            ui.session.colors.adjust(ids, kind, RANGES[kind].neutral)
        imgui.pop_style_color(2)
        ui.mark(f"inspector.adjust.{kind}.reset")
        if possible and imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
            imgui.set_tooltip(translate("Reset: {amount}", amount=phrase(SLIDERS[kind].title)))

    def _find_look(self, document: Document, ids: Ids) -> AdjustmentSummary:
        """Look up the instances' adjustments; the answer is kept until something changes."""
        key = (ids, document.versions.colors, document.versions.states, document.versions.table)
        return self._look.get(document, key, lambda: summarize_adjustments(document, ids))
