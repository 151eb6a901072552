"""What deletions and moves left behind: residue as dots, the hole hatched, and a box with buttons to repair both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from imgui_bundle import ImVec2, imgui
from jaxtyping import Float64
from numpy import ndarray

from instdrive_app.action import Action
from instdrive_app.language.translation import translate
from instdrive_app.panels.overlays.hole_pattern import HolePattern, build_hole_pattern, project_shapes
from instdrive_app.panels.widgets.theme import pack_color, rgba
from instdrive_app.panels.widgets.ui import Rectangle, Ui, get_icon, scale_pixels
from instdrive_app.preferences.themes import BACKGROUND, DIM, ERROR, PICTURE_ACCENT, PICTURE_SHADE, TEXT, Color, Role
from instdrive_app.session.deletion_review import DeletionFindings
from instdrive_app.state import ViewMode
from instdrive_core.edits.holes.holes import Hole
from instdrive_core.scene.camera import Camera
from instdrive_core.scene.scene import Scene
from instdrive_core.wording import format_count, phrase

MAX_DOTS = 1500
"""Dots drawn at most; more residue is thinned out."""
DOT = 2.5
"""Radius of a dot; like the other lengths in pixels at scale 1."""
MARGIN, PADDING, LINE_GAP, BUTTON_GAP = 10.0, 10.0, 6.0, 16.0
LEGEND_HEIGHT = 56.0
"""Height of what views other than colour show in the same corner."""


@dataclass(frozen=True)
class _Line:
    """One line of the box: what is left, and the action that repairs it."""

    text: str
    button: str
    command: Action


@dataclass(frozen=True)
class _Width:
    """Pixels that the words and the buttons of the box take. While one report is shown neither gets narrower: the next
    button stays where the mouse expects it."""

    words: float = 0.0
    buttons: float = 0.0


class DeletionOverlay:
    """Shows what is pending, and the report of the last of it."""

    def __init__(self) -> None:
        self._patterns: list[tuple[Hole, HolePattern]] = []
        self._width = _Width()
        self._shown: DeletionFindings | None = None

    def draw(self, ui: Ui, place: Rectangle) -> None:
        """Draw one frame."""
        found, document, snapshot = ui.session.deletion.review.findings, ui.session.document, ui.view.snapshot
        if found is not self._shown:
            self._width, self._shown = _Width(), found
        if found is None or document is None or snapshot is None:
            return
        draw = imgui.get_window_draw_list()
        draw.push_clip_rect(ImVec2(place.x, place.y), ImVec2(place.x + place.width, place.y + place.height), True)
        holes = [hole for each in ui.session.deletion.review.pending for hole in each.holes if hole.area]
        for hole in holes:
            _draw_pattern(self._find_pattern(hole), snapshot.camera, place)
        self._patterns = [known for known in self._patterns if any(known[0] is hole for hole in holes)]
        if found.residue_count:
            _draw_dots(_place_residue(found, document.scene, ui.session.state.time), snapshot.camera, place)
        draw.pop_clip_rect()
        self._width = _draw_box(ui, found, place, self._width)

    def _find_pattern(self, hole: Hole) -> HolePattern:
        for known, pattern in self._patterns:
            if known is hole:
                return pattern
        self._patterns.append((hole, build_hole_pattern(hole)))
        return self._patterns[-1][1]


def _draw_pattern(pattern: HolePattern, camera: Camera, place: Rectangle) -> None:
    draw = imgui.get_window_draw_list()
    stripes, hatching, outline = pattern.project(camera)
    # `add_quad_filled` would draw soft edges, which show where stripes meet.
    draw.prim_reserve(6 * len(stripes), 4 * len(stripes))
    blank, color = imgui.get_font_tex_uv_white_pixel(), pack_color(PICTURE_ACCENT, 0.18)
    for corners in stripes:
        a, b, c, d = (ImVec2(*place.locate_pixel(x, y)) for x, y in corners)
        draw.prim_quad_uv(a, b, c, d, blank, blank, blank, blank, color)
    for lines, alpha, width in ((hatching, 0.35, 1.0), (outline, 0.9, 1.5)):
        for (ax, ay), (bx, by) in lines:
            start, end = ImVec2(*place.locate_pixel(ax, ay)), ImVec2(*place.locate_pixel(bx, by))
            draw.add_line(start, end, pack_color(PICTURE_ACCENT, alpha), scale_pixels(width))


def _place_residue(found: DeletionFindings, scene: Scene, time: float) -> Float64[ndarray, "r 3"]:
    """World positions (metres) of at most `MAX_DOTS` splats of residue at a time in seconds."""
    step = -(-len(found.residue) // MAX_DOTS)
    places, nodes = found.residue[::step], found.nodes[::step]
    if not nodes.any():
        return places
    poses = scene.find_node_poses(time)[0][nodes]
    return np.einsum("nij,nj->ni", poses[:, :3, :3], places) + poses[:, :3, 3]


def _draw_dots(places: Float64[ndarray, "r 3"], camera: Camera, place: Rectangle) -> None:
    draw = imgui.get_window_draw_list()
    for ((x, y),) in project_shapes(places[:, None], camera):
        at = ImVec2(*place.locate_pixel(x, y))
        draw.add_circle_filled(at, scale_pixels(DOT + 1), pack_color(PICTURE_SHADE, 0.6), 12)
        draw.add_circle_filled(at, scale_pixels(DOT), pack_color(ERROR), 12)


def _draw_box(ui: Ui, found: DeletionFindings, place: Rectangle, least: _Width) -> _Width:
    lines = _compose_lines(ui, found)
    others = len(ui.session.deletion.review.pending) - 1
    title = (
        translate("{title}  (and {count} more)", title=found.title, count=others) if others else translate(found.title)
    )
    row, padding = imgui.get_frame_height() + scale_pixels(LINE_GAP), scale_pixels(PADDING)
    words = max(least.words, *(imgui.calc_text_size(text).x for text in (title, *(line.text for line in lines))))
    buttons = max(imgui.calc_text_size(line.button).x for line in lines) + 2 * imgui.get_style().frame_padding.x
    buttons = max(least.buttons, buttons)
    width = words + scale_pixels(BUTTON_GAP) + buttons + 2 * padding
    height = row * (1 + len(lines)) - scale_pixels(LINE_GAP) + 2 * padding
    left, bottom = place.x + scale_pixels(MARGIN), place.y + place.height - scale_pixels(MARGIN)
    if ui.session.state.view_mode is not ViewMode.COLOR:
        bottom -= scale_pixels(LEGEND_HEIGHT)
    low, high = ImVec2(left, bottom - height), ImVec2(left + width, bottom)
    imgui.get_window_draw_list().add_rect_filled(low, high, pack_color(BACKGROUND, 0.9), scale_pixels(6))
    ui.marks["deletion review"] = (low.x, low.y, high.x, high.y)
    _block_clicks(low, high)
    _draw_text(low.x + padding, low.y + padding, title, TEXT)
    _draw_close_button(ui, high.x - padding, low.y + padding)
    for number, line in enumerate(lines, start=1):
        top = low.y + padding + number * row
        _draw_text(low.x + padding, top, line.text, DIM)
        imgui.set_cursor_screen_pos(ImVec2(high.x - padding - buttons, top))
        imgui.begin_disabled(not line.command.enabled())
        if imgui.button(f"{line.button}###{line.command.id}", ImVec2(buttons, 0)):
            ui.session.actions.run(line.command.id)
        imgui.end_disabled()
        ui.mark(line.command.id)
    return _Width(words, buttons)


def _compose_lines(ui: Ui, found: DeletionFindings) -> list[_Line]:
    commands, lines = ui.session.actions, []
    if found.residue_count:
        text = phrase("{splats} of residue", splats=format_count(found.residue_count, "splat"))
        lines.append(
            _Line(
                translate(text),
                f"{get_icon('ICON_FA_BROOM')}  {translate('Absorb floaters')}",
                commands["deletion.absorb"],
            )
        )
    if found.holes:
        words = translate("Fill hole" if len(found.holes) == 1 else "Fill holes")
        if not found.report.holes:
            words = translate("Fill gap")
        if ui.session.deletion.review.is_filling:
            words = translate("Filling…")
        text = translate(found.report.hole_text)
        text = text[0].upper() + text[1:]
        lines.append(_Line(text, f"{get_icon('ICON_FA_FILL_DRIP')}  {words}", commands["deletion.fill"]))
    if sum(bool(each.holes) for each in ui.session.deletion.review.pending) > 1:
        icon = get_icon("ICON_FA_FILL_DRIP")
        lines.append(
            _Line(
                translate("Holes of earlier steps, too"),
                f"{icon}  {translate('Fill all holes')}",
                commands["deletion.fill_all"],
            )
        )
    return lines


def _block_clicks(low: ImVec2, high: ImVec2) -> None:
    """Keep clicks beside the buttons from the picture behind."""
    imgui.set_cursor_screen_pos(low)
    imgui.set_next_item_allow_overlap()
    imgui.invisible_button("##deletion review", ImVec2(high.x - low.x, high.y - low.y))


def _draw_text(left: float, top: float, text: str, color: Color | Role) -> None:
    at = ImVec2(left, top + imgui.get_style().frame_padding.y)
    imgui.get_window_draw_list().add_text(at, pack_color(color), text)


def _draw_close_button(ui: Ui, right: float, top: float) -> None:
    command, side = ui.session.actions["deletion.clear"], imgui.get_frame_height()
    imgui.set_cursor_screen_pos(ImVec2(right - side, top))
    imgui.push_style_color(imgui.Col_.button, rgba(BACKGROUND, 0.0))
    imgui.push_style_var(imgui.StyleVar_.frame_padding, ImVec2(0, 0))
    if imgui.button(f"{get_icon(command.icon)}##{command.id}", ImVec2(side, side)):
        ui.session.actions.run(command.id)
    imgui.pop_style_var()
    imgui.pop_style_color()
    ui.mark(command.id)
    if imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
        imgui.set_tooltip(translate("Close this report"))
