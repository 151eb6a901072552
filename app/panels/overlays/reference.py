"""The dataset camera's photo or masks: over the splats, beside them, in turn with them, or as their difference."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

from imgui_bundle import ImVec2, ImVec4, imgui

from instdrive_app.language.translation import translate
from instdrive_app.panels.overlays.wipe import WipeLine
from instdrive_app.panels.widgets.theme import pack_color
from instdrive_app.panels.widgets.ui import Rectangle, Ui, fit_text, scale_pixels
from instdrive_app.preferences.themes import BACKGROUND, DIM, PICTURE_ACCENT, PICTURE_SHADE, TEXT
from instdrive_app.session.showing.photo_difference import HEAT_RAMP, HOT, Difference
from instdrive_app.state import Comparison, Reference, ViewMode

GAP = 2
"""Pixels between the two pictures."""
FLICKER_SECONDS = 0.6
"""Time for which the splats and the photo are shown in turn."""


def split_viewport(ui: Ui, whole: Rectangle) -> tuple[Rectangle, Rectangle | None]:
    """Divide the viewport: the part for the splats, and the one for the photo if it is shown beside them."""
    state = ui.session.state
    if state.comparison is not Comparison.BESIDE or not state.compares:
        return whole, None
    half = (whole.width - GAP) // 2
    return replace(whole, x=whole.x + half + GAP, width=whole.width - half - GAP), replace(whole, width=half)


class ReferenceOverlay:
    """Shows photo or masks as chosen in the timeline; only dataset cameras have them."""

    def __init__(self) -> None:
        self._line = WipeLine()

    def draw(self, ui: Ui, place: Rectangle) -> None:
        """Draw the photo exactly where the camera's film is, in the way that is chosen."""
        state = ui.session.state
        if not state.compares or state.comparison is Comparison.BESIDE:
            return
        texture = _find_texture(ui)
        if texture is None:
            missing = _explain_missing(ui)
            if missing:
                _draw_note(ui, place, missing)
            return
        ui.marks["reference"] = (place.x, place.y, place.x + place.width, place.y + place.height)
        match state.comparison:
            case Comparison.WIPE:
                left, top, right, bottom = state.viewpoint.fit_film(place.width, place.height)
                film = (place.x + left, place.y + top, place.x + right, place.y + bottom)
                _draw_image(ui, place, texture, 1.0, state.wipe)
                self._line.draw(ui, film, place.y + scale_pixels(14) + imgui.get_frame_height())
                self._name_sides(ui, film)
            case Comparison.FLICKER:
                shows_photo = imgui.get_time() % (2 * FLICKER_SECONDS) < FLICKER_SECONDS
                if shows_photo:
                    _draw_image(ui, place, texture, 1.0)
                _draw_note(ui, place, translate((state.reference if shows_photo else Reference.NONE).value))
            case Comparison.ERROR:
                self._draw_difference(ui, place)
            case _:
                _draw_image(ui, place, texture, state.reference_opacity)

    def _name_sides(self, ui: Ui, film: tuple[float, float, float, float]) -> None:
        """Name what is left and right of the line, where there is room for it."""
        left, _, right, bottom = film
        border, gap = left + ui.session.state.wipe * (right - left), scale_pixels(10)
        top = _find_plate_top(bottom)
        photo, splats = (translate(kind.value) for kind in (ui.session.state.reference, Reference.NONE))
        if border - left > _measure_plate(photo) + 2 * gap:
            _draw_plate(border - gap - _measure_plate(photo), top, photo)
        if right - border > _measure_plate(splats) + 2 * gap:
            _draw_plate(border + gap, top, splats)

    def _draw_difference(self, ui: Ui, place: Rectangle) -> None:
        difference, found = ui.session.difference, ui.session.difference.current
        if ui.session.state.view_mode is not ViewMode.COLOR:
            _draw_note(ui, place, translate("The heat map compares colours; choose the colour view"))
        elif found is None:
            _draw_note(ui, place, translate(difference.problem or "Comparing with the photo…"))
        else:
            _draw_image(ui, place, ui.textures.show("difference", found.heat), 1.0)
            _draw_legend(ui, place, found)


def draw_reference_beside(ui: Ui, place: Rectangle) -> None:
    """Draw the photo or masks in their own half, and a cross where the pointer is in the other half."""
    draw = imgui.get_window_draw_list()
    corner = ImVec2(place.x + place.width, place.y + place.height)
    draw.add_rect_filled(ImVec2(place.x, place.y), corner, pack_color(BACKGROUND))
    texture = _find_texture(ui)
    if texture is None:
        text = _explain_missing(ui) or translate("Reading…")
        size = imgui.calc_text_size(text)
        middle = ImVec2(place.x + (place.width - size.x) / 2, place.y + place.height / 2)
        draw.add_text(middle, pack_color(DIM), text)
        return
    _draw_image(ui, place, texture, 1.0)
    _draw_plate(place.x + scale_pixels(10), place.y + scale_pixels(10), translate(ui.session.state.reference.value))
    ui.marks["reference"] = (place.x, place.y, corner.x, corner.y)
    if ui.pointer is not None:
        x, y = place.locate_pixel(*ui.pointer)
        arm = scale_pixels(9)
        for low, high in (((x - arm, y), (x + arm, y)), ((x, y - arm), (x, y + arm))):
            draw.add_line(ImVec2(*low), ImVec2(*high), pack_color(PICTURE_SHADE, 0.8), scale_pixels(3))
            draw.add_line(ImVec2(*low), ImVec2(*high), pack_color(PICTURE_ACCENT), scale_pixels(1))


def _find_texture(ui: Ui) -> int | None:
    session = ui.session
    document, index = session.document, session.state.dataset_view
    if document is None or index is None:
        return None
    picture = session.references.get(document.scene.views[index], session.state.reference)
    return None if picture is None else ui.textures.show("reference", picture)


def _draw_image(ui: Ui, place: Rectangle, texture: int, opacity: float, share: float = 1.0) -> None:
    """Draw a picture where the film is, or its left part of this share of the width."""
    left, top, right, bottom = ui.session.state.viewpoint.fit_film(place.width, place.height)
    right = left + share * (right - left)
    low, high = ImVec2(place.x + left, place.y + top), ImVec2(place.x + right, place.y + bottom)
    draw = imgui.get_window_draw_list()
    draw.push_clip_rect(ImVec2(place.x, place.y), ImVec2(place.x + place.width, place.y + place.height), True)
    tint = imgui.get_color_u32(ImVec4(1, 1, 1, opacity))
    draw.add_image(imgui.ImTextureRef(texture), low, high, ImVec2(0, 0), ImVec2(share, 1), tint)
    draw.pop_clip_rect()


def _draw_legend(ui: Ui, place: Rectangle, found: Difference) -> None:
    """Draw what the heat map's colours mean, and the figures of the whole picture."""
    gap = scale_pixels(10)
    words = (
        translate("PSNR {psnr:.1f} dB", psnr=found.psnr),
        translate("mean difference {share:.1f} %", share=100 * found.mean_error),
    )
    text, line = "  ·  ".join(words), imgui.get_text_line_height()
    width = min(max(imgui.calc_text_size(text).x, scale_pixels(220)), place.width - 4 * gap)
    left, top = place.x + 2 * gap, place.y + place.height - 2 * line - 4.5 * gap
    corner = ImVec2(left + width + gap, top + 2 * line + 3 * gap)
    draw = imgui.get_window_draw_list()
    draw.add_rect_filled(ImVec2(left - gap, top - gap / 2), corner, pack_color(BACKGROUND, 0.85), scale_pixels(4))
    ui.marks["viewport.difference"] = (left - gap, top - gap / 2, corner.x, corner.y)
    draw.add_text(ImVec2(left, top), pack_color(TEXT), text)
    part, bar = width / (len(HEAT_RAMP) - 1), top + line + 0.7 * gap
    for number, (first, second) in enumerate(pairwise(HEAT_RAMP)):
        low, high = ImVec2(left + number * part, bar), ImVec2(left + (number + 1) * part, bar + gap)
        a, b = pack_color(first), pack_color(second)
        draw.add_rect_filled_multi_color(low, high, a, b, b, a)
    end = translate("{share:.0f} % or more", share=100 * HOT)
    draw.add_text(ImVec2(left, bar + 1.2 * gap), pack_color(TEXT), translate("equal"))
    draw.add_text(ImVec2(left + width - imgui.calc_text_size(end).x, bar + 1.2 * gap), pack_color(TEXT), end)


def _explain_missing(ui: Ui) -> str:
    """Why there is no picture of this camera and time; empty if there may be one soon."""
    document, state = ui.session.document, ui.session.state
    if document is None or state.dataset_view is None:
        return ""
    view = document.scene.views[state.dataset_view]
    return translate(ui.session.references.explain_missing(view, state.reference))


def _draw_note(ui: Ui, place: Rectangle, text: str) -> None:
    """Draw text on a plate in the middle of the film's lower edge; the view modes are at the upper one."""
    _, _, _, bottom = ui.session.state.viewpoint.fit_film(place.width, place.height)
    text = fit_text(text, place.width - scale_pixels(40))
    left, top = place.x + (place.width - _measure_plate(text)) / 2, _find_plate_top(place.y + bottom)
    _draw_plate(left, top, text)
    high = imgui.get_text_line_height() + scale_pixels(10)
    ui.marks["viewport.note"] = (left, top, left + _measure_plate(text), top + high)


def _find_plate_top(bottom: float) -> float:
    """Place a plate above a film's lower edge."""
    return bottom - imgui.get_text_line_height() - scale_pixels(25)


def _draw_plate(left: float, top: float, text: str) -> None:
    """Draw text on a dark plate, which makes it readable on any picture."""
    draw, size = imgui.get_window_draw_list(), imgui.calc_text_size(text)
    wide, high = scale_pixels(10), scale_pixels(5)
    corner = ImVec2(left + _measure_plate(text), top + size.y + 2 * high)
    draw.add_rect_filled(ImVec2(left, top), corner, pack_color(BACKGROUND, 0.78), scale_pixels(4))
    draw.add_text(ImVec2(left + wide, top + high), pack_color(TEXT), text)


def _measure_plate(text: str) -> float:
    return imgui.calc_text_size(text).x + scale_pixels(20)
