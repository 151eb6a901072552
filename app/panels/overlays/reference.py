"""The dataset camera's photo or masks, over the splats or beside them."""

from __future__ import annotations

from imgui_bundle import ImVec2, ImVec4, imgui

from instdrive_app.language.translation import translate
from instdrive_app.panels.widgets.theme import pack_color
from instdrive_app.panels.widgets.ui import Rectangle, Ui, scale_pixels
from instdrive_app.preferences.themes import BACKGROUND, DIM, PICTURE_ACCENT, PICTURE_SHADE, TEXT
from instdrive_app.state import Reference

GAP = 2
"""Pixels between the two pictures."""


def split_viewport(ui: Ui, whole: Rectangle) -> tuple[Rectangle, Rectangle | None]:
    """Divide the viewport: the part for the splats, and the one for the photo if it is shown beside them."""
    state = ui.session.state
    if not state.reference_beside or state.reference is Reference.NONE or state.dataset_view is None:
        return whole, None
    half = (whole.width - GAP) // 2
    left = Rectangle(whole.x, whole.y, half, whole.height)
    return Rectangle(whole.x + half + GAP, whole.y, whole.width - half - GAP, whole.height), left


class ReferenceOverlay:
    """Shows photo or masks as chosen in the timeline; only dataset cameras have them."""

    def draw(self, ui: Ui, place: Rectangle) -> None:
        """Draw the photo over the splats exactly where the camera's film is, as opaque as the slider says."""
        state = ui.session.state
        if state.reference is Reference.NONE or state.reference_beside or state.dataset_view is None:
            return
        texture = _find_texture(ui)
        if texture is not None:
            _draw_image(ui, place, texture, state.reference_opacity)
            ui.marks["reference"] = (place.x, place.y, place.x + place.width, place.y + place.height)
        elif missing := _explain_missing(ui):
            _draw_plate(place.x + (place.width - _measure_plate(missing)) / 2, place.y + scale_pixels(10), missing)


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
        x, y = place.x + ui.pointer[0], place.y + ui.pointer[1]
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


def _draw_image(ui: Ui, place: Rectangle, texture: int, opacity: float) -> None:
    left, top, right, bottom = ui.session.state.viewpoint.fit_film(place.width, place.height)
    low, high = ImVec2(place.x + left, place.y + top), ImVec2(place.x + right, place.y + bottom)
    draw = imgui.get_window_draw_list()
    draw.push_clip_rect(ImVec2(place.x, place.y), ImVec2(place.x + place.width, place.y + place.height), True)
    tint = imgui.get_color_u32(ImVec4(1, 1, 1, opacity))
    draw.add_image(imgui.ImTextureRef(texture), low, high, ImVec2(0, 0), ImVec2(1, 1), tint)
    draw.pop_clip_rect()


def _explain_missing(ui: Ui) -> str:
    """Why there is no picture of this camera and time; empty if there may be one soon."""
    document, state = ui.session.document, ui.session.state
    if document is None or state.dataset_view is None:
        return ""
    view = document.scene.views[state.dataset_view]
    return translate(ui.session.references.explain_missing(view, state.reference))


def _draw_plate(left: float, top: float, text: str) -> None:
    """Draw text on a dark plate, which makes it readable on any picture."""
    draw, size = imgui.get_window_draw_list(), imgui.calc_text_size(text)
    wide, high = scale_pixels(10), scale_pixels(5)
    corner = ImVec2(left + _measure_plate(text), top + size.y + 2 * high)
    draw.add_rect_filled(ImVec2(left, top), corner, pack_color(BACKGROUND, 0.78), scale_pixels(4))
    draw.add_text(ImVec2(left + wide, top + high), pack_color(TEXT), text)


def _measure_plate(text: str) -> float:
    return imgui.calc_text_size(text).x + scale_pixels(20)
