"""Tracks and boxes of what moves, the recording car's way, and where the user looks from, drawn on the map."""

from __future__ import annotations

import numpy as np
from imgui_bundle import imgui
from jaxtyping import Float64
from numpy import ndarray

from instdrive_app.panels.map.canvas import MapCanvas
from instdrive_app.panels.widgets.theme import pack_color
from instdrive_app.panels.widgets.ui import Ui, get_swatch_color, scale_pixels
from instdrive_app.preferences.themes import PICTURE_ACCENT, PICTURE_SHADE, PICTURE_TEXT
from instdrive_app.session.mapping.map_things import MapThing, build_view_cone

CONE = 70.0
"""Length of the view's cone, pixels at scale 1."""
SPOT = 3.0
"""Half the side of what is reported as a thing's place, pixels at scale 1."""
DOT = 4.5
"""Radius of the mark where the user looks from, pixels at scale 1."""


def draw_movers(ui: Ui, canvas: MapCanvas, things: tuple[MapThing, ...]) -> None:
    """Draw tracks and boxes in the colours of their instances; selected and hovered ones stand out."""
    document = ui.session.document
    assert document is not None
    selected, hovered = set(ui.session.selection.ids), ui.session.state.hovered
    for thing in things:
        color = get_swatch_color(ui, document.scene.table[thing.id])
        is_marked, is_hovered = not selected.isdisjoint(thing.ids), hovered in thing.ids
        if len(thing.path):
            canvas.draw_path(thing.path, pack_color(PICTURE_SHADE, 0.45), 4.0 if is_marked else 3.0)
            canvas.draw_path(thing.path, imgui.get_color_u32(color), 2.4 if is_marked else 1.4)
        if thing.box is None:
            continue
        fill = imgui.ImVec4(color.x, color.y, color.z, 0.55)
        canvas.fill_shape(thing.box, imgui.get_color_u32(fill))
        edge = pack_color(PICTURE_ACCENT) if is_marked else pack_color(PICTURE_TEXT, 1.0 if is_hovered else 0.75)
        canvas.draw_path(thing.box, edge, 2.2 if is_marked else 1.2, closed=True)
        middle, front = thing.box.mean(axis=0), thing.box[:2].mean(axis=0)
        canvas.draw_path(np.stack([middle, front]), edge, 1.5)
        (spot,) = canvas.to_screen(middle[None])
        ui.mark_spot(f"gizmo.map.thing.{thing.id}", (spot.x, spot.y), SPOT, canvas.place)


def draw_way(canvas: MapCanvas, way: Float64[ndarray, "n d"] | None, car: Float64[ndarray, "2 2"] | None) -> None:
    """Draw the recording car's way, and the car at the present time as an arrow from `car[0]` towards `car[1]`."""
    if way is not None:
        canvas.draw_path(way, pack_color(PICTURE_SHADE, 0.5), 4.0)
        canvas.draw_path(way, pack_color(PICTURE_ACCENT, 0.9), 2.0)
    if car is not None:
        ahead = car[1] - car[0]
        side = np.array([-ahead[1], ahead[0]]) * 0.45
        arrow = np.stack([car[0] + 1.1 * ahead, car[0] - 0.9 * ahead + side, car[0] - 0.9 * ahead - side])
        canvas.fill_shape(arrow, pack_color(PICTURE_ACCENT))
        canvas.draw_path(arrow, pack_color(PICTURE_SHADE), 1.0, closed=True)


def draw_view(ui: Ui, canvas: MapCanvas) -> None:
    """Draw where the user looks from, and how far to the left and right he sees."""
    state, draw = ui.session.state, imgui.get_window_draw_list()
    length = scale_pixels(CONE) * canvas.window.scale
    place, corners = build_view_cone(state.viewpoint, state.picture_size, length)
    (eye,) = canvas.to_screen(place[None])
    if len(corners):
        canvas.fill_shape(np.concatenate([place[None], corners]), pack_color(PICTURE_TEXT, 0.28))
        canvas.draw_path(np.stack([corners[0], place, corners[1]]), pack_color(PICTURE_TEXT, 0.9), 1.2)
    draw.add_circle_filled(eye, scale_pixels(DOT + 1.5), pack_color(PICTURE_SHADE, 0.85))
    draw.add_circle_filled(eye, scale_pixels(DOT), pack_color(PICTURE_TEXT))
    ui.mark_spot("gizmo.map.eye", (eye.x, eye.y), DOT, canvas.place)
