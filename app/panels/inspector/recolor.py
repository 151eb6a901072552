"""Recolouring of instances: a row of presets, and a picker whose drags are one step each."""

from __future__ import annotations

from imgui_bundle import ImVec2, ImVec4, imgui

from instdrive_app.panels.widgets.gestures import Gesture
from instdrive_app.panels.widgets.ui import Ui, scale_size
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.color import RecolorMode

PRESETS: dict[str, tuple[float, float, float]] = {
    "red": (0.82, 0.13, 0.13),
    "orange": (0.93, 0.49, 0.10),
    "yellow": (0.93, 0.80, 0.18),
    "green": (0.18, 0.62, 0.30),
    "blue": (0.15, 0.38, 0.80),
    "purple": (0.52, 0.26, 0.74),
    "white": (0.92, 0.92, 0.92),
    "black": (0.08, 0.08, 0.09),
}
MODES: dict[RecolorMode, str] = {"tint": "Tint", "hue": "Hue", "solid": "Solid"}
MODE_HINTS: dict[RecolorMode, str] = {
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
            ui.session.colors.recolor(ids, ui.session.colors.mode, color)
            clicked = True
        ui.mark(f"{where}.color.{name}")
        if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
            imgui.set_tooltip(f"{MODES[ui.session.colors.mode]} {name}")
    imgui.pop_style_var()
    return clicked


class RecolorSection:
    """Draws mode switch, presets and colour picker for the selected instances."""

    title: str = "Colour"

    def __init__(self) -> None:
        self._gesture = Gesture("recolour")

    def draw(self, ui: Ui, document: Document, ids: tuple[int, ...]) -> None:
        """Draw one frame; every change is applied at once, and one drag in the picker is one step of the history."""
        session = ui.session
        for number, (mode, title) in enumerate(MODES.items()):
            if number:
                imgui.same_line()
            if imgui.radio_button(title, session.colors.mode == mode):
                session.colors.mode = mode
            ui.mark(f"inspector.mode.{mode}")
            if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
                imgui.set_tooltip(MODE_HINTS[mode])
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
            session.colors.recolor(ids, session.colors.mode, (r, g, b), gesture)
