"""Recolouring of instances: a row of presets, and a picker whose drags are one step each."""

from __future__ import annotations

from imgui_bundle import ImVec2, ImVec4, imgui

from instdrive_app.language.translation import make_label, translate
from instdrive_app.panels.widgets.gestures import Gesture
from instdrive_app.panels.widgets.theme import rgba
from instdrive_app.panels.widgets.ui import (
    Ui,
    draw_bounded_slider,
    draw_dim_text,
    get_icon,
    scale_pixels,
    scale_size,
)
from instdrive_app.preferences.themes import ACCENT, TEXT
from instdrive_app.session.color_controller import ColorMode
from instdrive_core.edits.bases.body_color import RGB, find_body_color
from instdrive_core.edits.document.document import Document
from instdrive_core.wording import phrase

PRESETS: dict[str, tuple[float, float, float]] = {
    phrase("red"): (0.82, 0.13, 0.13),
    phrase("orange"): (0.93, 0.49, 0.10),
    phrase("yellow"): (0.93, 0.80, 0.18),
    phrase("green"): (0.18, 0.62, 0.30),
    phrase("blue"): (0.15, 0.38, 0.80),
    phrase("purple"): (0.52, 0.26, 0.74),
    phrase("white"): (0.92, 0.92, 0.92),
    phrase("black"): (0.08, 0.08, 0.09),
}
MODES: dict[ColorMode, str] = {"paint": "Paint", "tint": "Tint", "hue": "Hue", "solid": "Solid"}
MODE_HINTS: dict[ColorMode, str] = {
    "paint": "Only the body takes this colour; glass, tyres and lights keep theirs",
    "tint": "Everything takes this colour; light, shade and reflections stay",
    "hue": "Hues become this colour's; greys, light and shade stay",
    "solid": "One flat colour from every direction",
}


def draw_preset_row(ui: Ui, where: str, ids: tuple[int, ...]) -> bool:
    """Draw one small button per preset, which recolours the instances; returns whether one was clicked."""
    size, clicked = imgui.get_frame_height() * 0.86, False
    imgui.push_style_var(imgui.StyleVar_.item_spacing, scale_size(5, 5))
    for number, (name, color) in enumerate(PRESETS.items()):
        if number:
            imgui.same_line()
        flags = imgui.ColorEditFlags_.no_tooltip | imgui.ColorEditFlags_.no_drag_drop
        if imgui.color_button(f"##{where}.{name}", ImVec4(*color, 1.0), flags, ImVec2(size, size)):
            ui.session.colors.color = color
            ui.session.colors.recolor(ids, ui.session.colors.find_mode(ids), color)
            clicked = True
        ui.mark(f"{where}.color.{name}")
        if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
            mode = phrase(MODES[ui.session.colors.find_mode(ids)])
            imgui.set_tooltip(translate("{mode}: {color}", mode=mode, color=phrase(name)))
    imgui.pop_style_var()
    return clicked


class RecolorSection:
    """Draws mode switch, presets and colour picker for the selected instances."""

    title: str = "Colour"

    def __init__(self) -> None:
        self._gesture, self._picker, self._reach = Gesture("recolour"), Gesture("picker"), Gesture("tolerance")

        self._body: tuple[tuple[Document, int, int], RGB] | None = None

    def draw(self, ui: Ui, document: Document, ids: tuple[int, ...]) -> None:
        """Draw one frame; every change is applied at once, and one drag in the picker is one step of the history."""
        session, chosen = ui.session, ui.session.colors.find_mode(ids)
        for number, (mode, title) in enumerate(MODES.items()):
            if number:
                imgui.same_line()
            if imgui.radio_button(make_label(title), chosen == mode):
                session.colors.mode = mode
            ui.mark(f"inspector.mode.{mode}")
            if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
                imgui.set_tooltip(translate(MODE_HINTS[mode]))
        draw_preset_row(ui, "inspector", ids)
        flags = imgui.ColorEditFlags_
        style = flags.no_alpha | flags.display_hex | flags.picker_hue_wheel | flags.no_options | flags.no_label
        imgui.same_line()
        imgui.set_next_item_width(-1)
        pressed = imgui.is_mouse_clicked(0)
        changed, picked = imgui.color_edit3("##recolor", list(session.colors.color), style)
        gesture = self._gesture.name_drag(pressed)
        ui.mark("inspector.color")
        if changed:
            r, g, b = (min(max(float(channel), 0.0), 1.0) for channel in picked)
            session.colors.color = (r, g, b)
            session.colors.recolor(ids, session.colors.find_mode(ids), (r, g, b), gesture)
        if session.colors.find_mode(ids) == "paint":
            self._draw_reach(ui, document, ids)
        self._draw_picker(ui, ids)

    def _draw_reach(self, ui: Ui, document: Document, ids: tuple[int, ...]) -> None:
        """Draw the colour that is replaced, and how far from it splats may be."""
        colors, flags = ui.session.colors, imgui.ColorEditFlags_
        shown = colors.reference or self._find_body_color(document, ids)
        imgui.color_button("##replaced", ImVec4(*shown, 1.0), flags.no_tooltip | flags.no_drag_drop)
        if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
            imgui.set_tooltip(translate("The colour that is replaced"))
        imgui.same_line()
        imgui.push_style_color(imgui.Col_.text, rgba(ACCENT if colors.picks_reference else TEXT))
        if imgui.button(get_icon("ICON_FA_EYE_DROPPER")):
            colors.picks_reference = not colors.picks_reference
        imgui.pop_style_color()
        ui.mark("inspector.reference")
        if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
            imgui.set_tooltip(translate("Click, then click into the view: that colour is replaced"))
        if colors.reference is not None:
            imgui.same_line()
            if imgui.button(get_icon("ICON_FA_ARROW_ROTATE_LEFT")):
                colors.set_reference(ids, None)
            if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
                imgui.set_tooltip(translate("Replace the colour of the body"))
        imgui.same_line()
        imgui.set_next_item_width(-1)
        changed, percent = draw_bounded_slider(
            "##tolerance", 100 * colors.tolerance, 0, 100, translate("Tolerance %.0f %%")
        )
        gesture = self._reach.name_drag()
        ui.mark("inspector.tolerance")
        if changed:
            colors.set_tolerance(ids, percent / 100, gesture)

    def _find_body_color(self, document: Document, ids: tuple[int, ...]) -> RGB:
        key = (document, ids[0], document.versions.table)
        if self._body is None or self._body[0] != key:
            rows = document.find_rows(ids[:1])
            found = find_body_color(document.scene.gaussians, rows) if len(rows) else (0.5, 0.5, 0.5)
            self._body = (key, found)
        return self._body[1]

    def _draw_picker(self, ui: Ui, ids: tuple[int, ...]) -> None:
        """Draw the large picker that the command opens; nothing changes before a colour is chosen in it."""
        colors = ui.session.colors
        if colors.take_question():
            imgui.open_popup("##picker")
        if not imgui.begin_popup("##picker"):
            return
        draw_dim_text(translate("{mode}: the selection", mode=phrase(MODES[colors.find_mode(ids)])))
        draw_preset_row(ui, "picker", ids)
        pressed, flags = imgui.is_mouse_clicked(0), imgui.ColorEditFlags_
        style = flags.no_alpha | flags.no_side_preview | flags.picker_hue_wheel | flags.display_hex
        imgui.set_next_item_width(scale_pixels(180))
        changed, picked = imgui.color_picker3("##wheel", list(colors.color), style)
        gesture = self._picker.name_drag(pressed)
        ui.mark("picker.wheel")
        if changed:
            r, g, b = (min(max(float(channel), 0.0), 1.0) for channel in picked)
            colors.color = (r, g, b)
            colors.recolor(ids, colors.find_mode(ids), (r, g, b), gesture)
        imgui.end_popup()
