"""The buttons that choose the view mode, at the picture's top left."""

from __future__ import annotations

from imgui_bundle import ImVec2, imgui

from instdrive_app.action import format_shortcut
from instdrive_app.language.translation import translate
from instdrive_app.panels.widgets.theme import pop_accent_fill, push_accent_fill, push_plate_fill
from instdrive_app.panels.widgets.ui import Rectangle, Ui, get_icon, scale_pixels, scale_size
from instdrive_app.state import ViewMode

WORDS_FROM = 54
"""Width of the picture, in font sizes, from which all buttons have words, and not only that of the present mode."""


class ViewSwitch:
    """Draws one button per view mode and highlights the present one."""

    def draw(self, ui: Ui, place: Rectangle) -> None:
        """Draw one frame."""
        narrow = place.width < WORDS_FROM * imgui.get_font_size()
        imgui.set_cursor_screen_pos(ImVec2(place.x + scale_pixels(10), place.y + scale_pixels(10)))
        imgui.push_style_var(imgui.StyleVar_.item_spacing, scale_size(2, 0))
        button = imgui.calc_text_size(get_icon("ICON_FA_PALETTE")).x + 2 * imgui.get_style().frame_padding.x
        room = int((place.width - scale_pixels(12)) / (button * 1.12 + scale_pixels(2)))
        is_cramped = room < len(ViewMode) + 3
        for number, mode in enumerate(ViewMode):
            if number >= room:
                break  # the menu and the keys have them all
            command = ui.session.actions[f"view.{mode.name.lower()}"]
            on = ui.session.state.view_mode is mode
            push_accent_fill() if on else push_plate_fill(0.78)
            word = "" if is_cramped or (narrow and not on) else f"  {translate(mode.value)}"
            if imgui.button(f"{get_icon(command.icon)}{word}###{command.id}"):
                command.run()
            pop_accent_fill()
            ui.mark(command.id)
            if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
                imgui.set_tooltip(f"{translate(mode.value)}  ({format_shortcut(command.shortcuts[0])})")
            imgui.same_line()
        imgui.pop_style_var()
