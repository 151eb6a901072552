"""The editor's look in ImGui's terms: the colours of the present theme, fonts, roundings and spacings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import imgui_bundle
from imgui_bundle import ImVec2, ImVec4, hello_imgui, imgui

from instdrive_app.files.system_fonts import find_fallback_fonts, list_font_folders
from instdrive_app.preferences.themes import (
    ACCENT,
    BACKGROUND,
    DEFAULT_THEME,
    DIM,
    HOVER,
    LINE,
    ON_ACCENT,
    PANEL,
    POPUP,
    RAISED,
    TEXT,
    THEMES,
    Color,
    Role,
    Theme,
)

FONT_SIZE = 15.0


_present: list[Theme] = [THEMES[DEFAULT_THEME]]
"""The one theme that is shown; ImGui's style, too, is one for the whole program."""


def look_up(color: Color | Role) -> Color:
    """Look up what a role's colour is in the present theme; other colours stay as they are."""
    return getattr(_present[0], color.value) if isinstance(color, Role) else color


def rgba(color: Color | Role, alpha: float = 1.0) -> ImVec4:
    """Make an ImGui colour."""
    return ImVec4(*look_up(color), alpha)


def push_accent_fill() -> None:
    """Fill the buttons that follow with the accent, until `pop_accent_fill`; their text can be read while hovered."""
    fill = imgui.Col_
    for index in (fill.button, fill.button_hovered, fill.button_active):
        imgui.push_style_color(index, rgba(ACCENT))
    imgui.push_style_color(fill.text, rgba(ON_ACCENT))


def push_plate_fill(alpha: float, text: Role = TEXT) -> None:
    """Let the buttons that follow lie on the picture as a plate of this opacity, until `pop_accent_fill`."""
    fill = imgui.Col_
    imgui.push_style_color(fill.button, rgba(BACKGROUND, alpha))
    imgui.push_style_color(fill.button_hovered, rgba(HOVER))
    imgui.push_style_color(fill.button_active, rgba(HOVER))
    imgui.push_style_color(fill.text, rgba(text))


def pop_accent_fill() -> None:
    """Let buttons look as they did before `push_accent_fill` or `push_plate_fill`."""
    imgui.pop_style_color(4)


def pack_color(color: Color | Role, alpha: float = 1.0) -> int:
    """Pack a colour into the integer that draw lists take."""
    return imgui.get_color_u32(rgba(color, alpha))


@dataclass
class Fonts:
    """The fonts, which `load_fonts` loads at the window's first frame."""

    regular: imgui.ImFont
    bold: imgui.ImFont

    def find_missing(self, text: str) -> str:
        """Find the characters of a text that no loaded font has, each once and in order."""
        return "".join(
            dict.fromkeys(
                letter for letter in text if letter.isprintable() and not self.regular.is_glyph_in_font(ord(letter))
            )
        )


def load_fonts() -> Fonts:
    """Load Roboto with the icons of Font Awesome 6, which imgui-bundle ships; what both lack comes from the system."""
    hello_imgui.set_assets_folder(str(Path(imgui_bundle.__file__).parent / "assets"))
    fallbacks = find_fallback_fonts(list_font_folders())
    return Fonts(*(_load_font(f"fonts/Roboto/Roboto-{weight}.ttf", fallbacks) for weight in ("Regular", "Bold")))


def _load_font(name: str, fallbacks: Sequence[Path]) -> imgui.ImFont:
    font = hello_imgui.load_font_ttf_with_font_awesome_icons(name, FONT_SIZE)
    for path in fallbacks:
        merged = hello_imgui.FontLoadingParams()
        merged.inside_assets, merged.merge_to_last_font = False, True
        hello_imgui.load_font(str(path), FONT_SIZE, merged)
    return font


def apply_style() -> None:
    """Set ImGui's colours, roundings and spacings."""
    style = imgui.get_style()
    style.window_padding, style.frame_padding = ImVec2(10, 8), ImVec2(8, 4)
    style.item_spacing, style.item_inner_spacing = ImVec2(8, 6), ImVec2(6, 4)
    style.cell_padding, style.indent_spacing = ImVec2(6, 3), 14
    style.window_rounding = style.child_rounding = style.popup_rounding = 6
    style.frame_rounding = style.grab_rounding = style.tab_rounding = 4
    style.scrollbar_size, style.scrollbar_rounding = 10, 5
    style.window_border_size = style.child_border_size = style.popup_border_size = 1
    style.tab_border_size = 0
    style.tab_bar_border_size, style.tab_bar_overline_size = 1, 2
    style.docking_separator_size = 2
    style.window_menu_button_position = imgui.Dir.none
    apply_theme(THEMES[DEFAULT_THEME])


def apply_theme(theme: Theme) -> None:
    """Show the window in the colours of a theme from the next frame on."""
    _present[0] = theme
    style = imgui.get_style()
    (imgui.style_colors_light if theme.is_light else imgui.style_colors_dark)()
    style.frame_border_size = theme.frame_border
    for index, color in _build_colors().items():
        style.set_color_(index, color)


def _build_colors() -> dict[int, ImVec4]:
    col, fill = imgui.Col_, _present[0].fill
    return {
        col.text: rgba(TEXT),
        col.text_disabled: rgba(DIM),
        col.window_bg: rgba(PANEL),
        col.child_bg: rgba(PANEL, 0.0),
        col.popup_bg: rgba(POPUP, 0.99),
        col.border: rgba(LINE),
        col.border_shadow: rgba(LINE, 0.0),
        col.frame_bg: rgba(RAISED),
        col.frame_bg_hovered: rgba(HOVER),
        col.frame_bg_active: rgba(HOVER),
        col.title_bg: rgba(BACKGROUND),
        col.title_bg_active: rgba(BACKGROUND),
        col.title_bg_collapsed: rgba(BACKGROUND),
        col.menu_bar_bg: rgba(BACKGROUND),
        col.scrollbar_bg: rgba(PANEL, 0.0),
        col.scrollbar_grab: rgba(HOVER),
        col.scrollbar_grab_hovered: rgba(DIM, 0.6),
        col.scrollbar_grab_active: rgba(DIM, 0.8),
        col.check_mark: rgba(ACCENT),
        # The value is written over the thumb, and must be readable there.
        col.slider_grab: rgba(ACCENT, fill),
        col.slider_grab_active: rgba(ACCENT, fill),
        col.button: rgba(RAISED),
        col.button_hovered: rgba(HOVER),
        col.button_active: rgba(ACCENT, fill),
        col.header: rgba(ACCENT, 0.7 * fill),
        col.header_hovered: rgba(HOVER),
        col.header_active: rgba(ACCENT, fill),
        col.separator: rgba(LINE),
        col.separator_hovered: rgba(ACCENT, 0.6),
        col.separator_active: rgba(ACCENT),
        col.resize_grip: rgba(LINE, 0.0),
        col.resize_grip_hovered: rgba(ACCENT, 0.4),
        col.resize_grip_active: rgba(ACCENT, 0.7),
        col.tab: rgba(BACKGROUND),
        col.tab_hovered: rgba(HOVER),
        col.tab_selected: rgba(PANEL),
        col.tab_selected_overline: rgba(ACCENT),
        col.tab_dimmed: rgba(BACKGROUND),
        col.tab_dimmed_selected: rgba(PANEL),
        col.tab_dimmed_selected_overline: rgba(ACCENT, 0.45),
        col.docking_preview: rgba(ACCENT, 0.4),
        col.docking_empty_bg: rgba(BACKGROUND),
        col.table_header_bg: rgba(BACKGROUND),
        col.table_border_strong: rgba(LINE),
        col.table_border_light: rgba(LINE, 0.6),
        col.table_row_bg: rgba(PANEL, 0.0),
        col.table_row_bg_alt: rgba(TEXT, 0.018),
        col.text_selected_bg: rgba(ACCENT, fill),
        col.nav_cursor: rgba(ACCENT),
        col.modal_window_dim_bg: rgba((0.0, 0.0, 0.0), 0.55),
    }
