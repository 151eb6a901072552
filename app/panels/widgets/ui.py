"""What panels share: session, view, fonts, small widgets, and marks that say where widgets are."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field
from math import isfinite

import numpy as np
from imgui_bundle import ImVec2, ImVec4, icons_fontawesome_6, imgui

from instdrive_app.action import Action, format_shortcut
from instdrive_app.actions.conditions import run_or_explain
from instdrive_app.jobs import Job
from instdrive_app.language.translation import translate
from instdrive_app.panels.widgets.shortcuts import PressedKeys
from instdrive_app.panels.widgets.theme import FONT_SIZE, Fonts, pack_color, rgba
from instdrive_app.pointer import Tool
from instdrive_app.preferences.instance_colors import paint_safe_colors
from instdrive_app.preferences.themes import ACCENT, DIM, TEXT
from instdrive_app.render.live_view import LiveView
from instdrive_app.render.picture_textures import PictureTextures
from instdrive_app.session.editor_session import EditorSession
from instdrive_core.instances.table import Instance
from instdrive_core.wording import phrase

CUT_SLACK = 8.0
"""Pixels at scale 1 of a widget that may be hidden: rows reach into the gaps beside them."""
Rect = tuple[float, float, float, float]


@dataclass(frozen=True)
class Rectangle:
    """An area of the window, in the pixels of mouse and widgets: on some displays each is several of the screen's."""

    x: float
    y: float
    width: int
    height: int
    density: float = 1.0
    """Pixels of the screen, along each axis, for one of the window."""

    @property
    def picture_size(self) -> tuple[int, int]:
        """Width and height of a picture that fills the area with the screen's own pixels."""
        return round(self.width * self.density), round(self.height * self.density)

    def find_pixel(self, x: float, y: float) -> tuple[float, float]:
        """Find the place in the picture, in its pixels, of a place in the window."""
        return (x - self.x) * self.density, (y - self.y) * self.density

    def locate_pixel(self, x: float, y: float) -> tuple[float, float]:
        """Locate a place in the picture, in its pixels, in the window."""
        return self.x + x / self.density, self.y + y / self.density


@dataclass
class Ui:
    """What every panel is given to draw itself."""

    session: EditorSession
    view: LiveView
    sketch_view: LiveView
    """Shows the sketch of a scene that is being opened."""
    tools: dict[str, Tool]
    """By the names that `EditorState.tool` takes."""
    fonts: Fonts
    textures: PictureTextures
    pointer: tuple[float, float] | None = None
    """Position of the mouse in the picture, in its pixels; None while it is elsewhere."""
    script_pointer: tuple[float, float] | None = None
    """Position in the picture, in its pixels, where a script holds the pointer instead of the mouse."""
    popup_open: bool = False
    """Whether a menu or dialog was open when the last frame ended: the key that closed it must do nothing else."""
    keys: PressedKeys = field(default_factory=PressedKeys)
    """Says which shortcut is pressed in this frame."""
    claimed_shortcuts: frozenset[str] = frozenset()
    """Shortcuts of commands that a panel with the keyboard has used for itself in the frame before."""
    marks: dict[str, Rect] = field(default_factory=dict)
    """Left, top, right, bottom of the visible part of named widgets in this frame, in window pixels."""
    cut: set[str] = field(default_factory=set)
    """Names of widgets whose left or right end is outside their panel, because the panel is too narrow."""
    disabled: set[str] = field(default_factory=set)
    """Names of widgets in `marks` that do not take a click in this frame."""

    @property
    def tool(self) -> Tool:
        """The current tool."""
        return self.tools[self.session.state.tool]

    def mark(self, name: str) -> None:
        """Record where the last widget is, unless it is scrolled out of view."""
        low, high = imgui.get_item_rect_min(), imgui.get_item_rect_max()
        seen = imgui.internal.get_current_window().outer_rect_clipped
        left, right = max(low.x, seen.min.x), min(high.x, seen.max.x)
        top, bottom = max(low.y, seen.min.y), min(high.y, seen.max.y)
        if left < right and top < bottom:
            self.marks[name] = (left, top, right, bottom)
            if right - left < high.x - low.x - scale_pixels(CUT_SLACK):
                self.cut.add(name)
            if imgui.get_item_flags() & imgui.ItemFlags_.disabled:
                self.disabled.add(name)

    def mark_spot(self, name: str, spot: tuple[float, float], reach: float, place: Rectangle) -> None:
        """Record a drawn spot (window pixels) that reaches so far, in pixels at scale 1, where it lies in `place`."""
        (x, y), far = spot, scale_pixels(reach)
        if place.x + far <= x <= place.x + place.width - far and place.y + far <= y <= place.y + place.height - far:
            self.marks[name] = (x - far, y - far, x + far, y + far)

    def forget_marks(self) -> None:
        """Forget all marks; call it before a frame."""
        self.marks.clear()
        self.cut.clear()
        self.disabled.clear()


def scale_pixels(pixels: float) -> float:
    """Convert a length from pixels at scale 1, where the font is `FONT_SIZE` high, to pixels of this window."""
    return pixels * imgui.get_font_size() / FONT_SIZE


def scale_size(width: float, height: float) -> ImVec2:
    """Convert width and height from pixels at scale 1; 0 and -1 keep the meaning that ImGui gives them."""
    return ImVec2(*(length if length in (0, -1) else scale_pixels(length) for length in (width, height)))


def get_icon(name: str) -> str:
    """Look up the character of an icon constant such as ``ICON_FA_TRASH``."""
    return getattr(icons_fontawesome_6, name)


def make_icon_label(symbol: str, text: str, key: str = "", gap: str = "  ") -> str:
    """Write a label of an icon and a text in the language of the window, whose ID is the same in all of them."""
    return f"{get_icon(symbol)}{gap}{translate(text)}###{key or text}"


def name_work(job: Job) -> str:
    """Say what a job is doing, in the language of the window."""
    return translate("Stopping…") if job.stop.is_set() else translate("{work}…", work=phrase(job.title))


def get_swatch_color(ui: Ui, instance: Instance) -> ImVec4:
    """Look up an instance's colour in the ID view."""
    number = np.array(instance.id, np.uint32)
    r, g, b = paint_safe_colors(number).tolist() if ui.session.state.safe_colors else instance.color
    return ImVec4(r / 255, g / 255, b / 255, 1.0)


def draw_swatch(ui: Ui, instance: Instance, size: float = 0.0) -> None:
    """Draw a small square in the instance's ID colour on the text line."""
    size = size or imgui.get_text_line_height() * 0.8
    at = imgui.get_cursor_screen_pos()
    top = at.y + (imgui.get_text_line_height() - size) / 2
    low, high = ImVec2(at.x, top), ImVec2(at.x + size, top + size)
    draw = imgui.get_window_draw_list()
    draw.add_rect_filled(low, high, imgui.get_color_u32(get_swatch_color(ui, instance)), scale_pixels(3))
    draw.add_rect(low, high, pack_color(TEXT, 0.25), scale_pixels(3))
    imgui.dummy(ImVec2(size, imgui.get_text_line_height()))


def draw_dim_text(text: str) -> None:
    """Draw dimmed text."""
    imgui.text_colored(rgba(DIM), text)


def draw_action_button(ui: Ui, command: Action, size: ImVec2 | None = None) -> None:
    """Draw an icon button that runs an action, with title and shortcut as its tooltip."""
    on = command.checked is not None and command.checked()
    imgui.begin_disabled(not command.enabled())
    imgui.push_style_color(imgui.Col_.text, rgba(ACCENT if on else TEXT))
    if imgui.button(f"{get_icon(command.icon)}##{command.id}", size or ImVec2(0, 0)):
        run_or_explain(ui.session, command)
    imgui.pop_style_color()
    imgui.end_disabled()
    ui.mark(command.id)
    if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip | imgui.HoveredFlags_.allow_when_disabled):
        shortcut = f"  ({format_shortcut(command.shortcuts[0])})" if command.shortcuts else ""
        imgui.set_tooltip(f"{translate(command.title)}{shortcut}")


def begin_icon_submenu(symbol: str, title: str, enabled: bool = True) -> bool:
    """Begin a submenu with an icon; returns whether it is open and must be ended."""
    at, space = _measure_icon_column()
    draw = imgui.get_window_draw_list()  # of the menu around it: an open submenu is a window of its own
    opened = imgui.begin_menu(f"{space}{title}", enabled)
    _draw_icon(draw, at, symbol, enabled)
    return opened


def draw_icon_menu_item(
    symbol: str, title: str, shortcut: str = "", checked: bool = False, enabled: bool = True
) -> bool:
    """Draw a menu item with an icon; returns whether it was clicked."""
    at, space = _measure_icon_column()
    clicked, _ = imgui.menu_item(f"{space}{title}", shortcut, checked, enabled)
    _draw_icon(imgui.get_window_draw_list(), at, symbol, enabled)
    return clicked


def _measure_icon_column() -> tuple[ImVec2, str]:
    """Where a menu item begins, and blanks as wide as its icon's column."""
    at, width = imgui.get_cursor_screen_pos(), imgui.get_font_size() * 1.3
    return at, " " * int(np.ceil((width + scale_pixels(8)) / imgui.calc_text_size(" ").x))


def _draw_icon(draw: imgui.ImDrawList, at: ImVec2, symbol: str, enabled: bool) -> None:
    glyph, width = get_icon(symbol), imgui.get_font_size() * 1.3
    place = ImVec2(at.x + (width - imgui.calc_text_size(glyph).x) / 2, at.y)
    draw.add_text(place, pack_color(TEXT if enabled else DIM, 1.0 if enabled else 0.6), glyph)


def draw_fitted_selectable(title: str, key: object, chosen: bool, flags: int = 0) -> bool:
    """Draw a line of a list and return whether it was clicked; a long title is cut, and whole in its tooltip."""
    fitted = fit_text(title, imgui.get_content_region_avail().x)
    clicked = imgui.selectable(f"{fitted}##{key}", chosen, flags, ImVec2(imgui.get_content_region_avail().x, 0))[0]
    if fitted != title and imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
        imgui.set_tooltip(title)
    return clicked


def draw_bounded_slider(
    label: str, value: float, low: float, high: float, form: str, flags: int = 0
) -> tuple[bool, float]:
    """Draw a slider; returns whether its value changed, and the value. A typed value is clamped; NaN is ignored."""
    changed, entered = imgui.slider_float(label, value, low, high, form, flags | imgui.SliderFlags_.always_clamp)
    if not changed or not isfinite(entered):  # "nan" is read as one
        return False, value
    return True, entered


def fit_text(text: str, width: float) -> str:
    """Cut text with an ellipsis if it is wider than `width` pixels."""
    if imgui.calc_text_size(text).x <= width:
        return text
    kept = bisect_right(range(1, len(text) + 1), width, key=lambda count: imgui.calc_text_size(f"{text[:count]}…").x)
    return f"{text[:kept]}…"
