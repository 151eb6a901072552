"""The editor's look: dark and quiet, with one warm accent that the selection's outline shares."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import imgui_bundle
from imgui_bundle import ImVec2, ImVec4, hello_imgui, imgui

from instdrive_app.files.system_fonts import find_fallback_fonts, list_font_folders

Color = tuple[float, float, float]

BACKGROUND: Color = (0.086, 0.094, 0.106)
PANEL: Color = (0.114, 0.122, 0.137)
RAISED: Color = (0.165, 0.176, 0.196)
HOVER: Color = (0.220, 0.235, 0.262)
LINE: Color = (0.200, 0.212, 0.235)
TEXT: Color = (0.885, 0.895, 0.910)
DIM: Color = (0.565, 0.590, 0.630)
ACCENT: Color = (1.000, 0.720, 0.200)
ERROR: Color = (0.960, 0.380, 0.340)
GOOD: Color = (0.420, 0.780, 0.520)

FONT_SIZE = 15.0


def rgba(color: Color, alpha: float = 1.0) -> ImVec4:
    """Make an ImGui colour."""
    return ImVec4(*color, alpha)


def pack_color(color: Color, alpha: float = 1.0) -> int:
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
    imgui.style_colors_dark()
    style.window_padding, style.frame_padding = ImVec2(10, 8), ImVec2(8, 4)
    style.item_spacing, style.item_inner_spacing = ImVec2(8, 6), ImVec2(6, 4)
    style.cell_padding, style.indent_spacing = ImVec2(6, 3), 14
    style.window_rounding = style.child_rounding = style.popup_rounding = 6
    style.frame_rounding = style.grab_rounding = style.tab_rounding = 4
    style.scrollbar_size, style.scrollbar_rounding = 10, 5
    style.window_border_size = style.child_border_size = style.popup_border_size = 1
    style.frame_border_size = style.tab_border_size = 0
    style.tab_bar_border_size, style.tab_bar_overline_size = 1, 2
    style.docking_separator_size = 2
    style.window_menu_button_position = imgui.Dir.none
    for index, color in _build_colors().items():
        style.set_color_(index, color)


def _build_colors() -> dict[int, ImVec4]:
    col = imgui.Col_
    return {
        col.text: rgba(TEXT),
        col.text_disabled: rgba(DIM),
        col.window_bg: rgba(PANEL),
        col.child_bg: rgba(PANEL, 0.0),
        col.popup_bg: rgba((0.135, 0.145, 0.162), 0.99),
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
        col.slider_grab: rgba(ACCENT, 0.45),
        col.slider_grab_active: rgba(ACCENT, 0.6),
        col.button: rgba(RAISED),
        col.button_hovered: rgba(HOVER),
        col.button_active: rgba(ACCENT, 0.45),
        col.header: rgba(ACCENT, 0.20),
        col.header_hovered: rgba(HOVER),
        col.header_active: rgba(ACCENT, 0.32),
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
        col.table_row_bg_alt: rgba((1.0, 1.0, 1.0), 0.018),
        col.text_selected_bg: rgba(ACCENT, 0.35),
        col.nav_cursor: rgba(ACCENT),
        col.modal_window_dim_bg: rgba((0.0, 0.0, 0.0), 0.55),
    }
