"""The clip's cameras where they stood, and the way of the recording car; a click looks through one of them."""

from __future__ import annotations

import numpy as np
from imgui_bundle import ImVec2, imgui
from jaxtyping import Float64
from numpy import ndarray

from instdrive_app.language.translation import translate
from instdrive_app.panels.overlays.world_pen import WorldPen
from instdrive_app.panels.widgets.theme import pack_color
from instdrive_app.panels.widgets.ui import Rectangle, Ui, scale_pixels
from instdrive_app.preferences.themes import PICTURE_ACCENT, PICTURE_SHADE, PICTURE_TEXT
from instdrive_core.wording import phrase

DOT = 2.5
"""Radius of the mark at a camera's place, pixels at scale 1."""
EDGES = np.array([(0, 1), (0, 2), (0, 3), (0, 4), (1, 2), (2, 3), (3, 4), (4, 1)])
"""Corners of a frustum that an edge joins; the first corner is the camera's place."""


class CamerasOverlay:
    """Draws frusta; the one under the mouse is highlighted and named."""

    def draw(self, ui: Ui, place: Rectangle) -> None:
        """Draw one frame."""
        snapshot, document, state = ui.view.snapshot, ui.session.document, ui.session.state
        if not state.show_cameras or snapshot is None or document is None:
            return
        cameras, draw = ui.session.cameras, imgui.get_window_draw_list()
        draw.push_clip_rect(ImVec2(place.x, place.y), ImVec2(place.x + place.width, place.y + place.height), True)
        self._draw_way(ui, WorldPen(snapshot.camera, place, 2.0))
        shown, pen = np.array(cameras.list_shown(), np.int64), WorldPen(snapshot.camera, place, 1.2)
        if not state.show_all_cameras:
            shade = WorldPen(snapshot.camera, place, 3.0)
            shade.draw_lines(_list_edges(cameras.find_frusta()[shown]), pack_color(PICTURE_SHADE, 0.5))
        is_hovered = shown == state.hovered_camera
        plain = pack_color(PICTURE_TEXT, 0.35 if state.show_all_cameras else 0.7)
        for chosen, color in ((shown[~is_hovered], plain), (shown[is_hovered], pack_color(PICTURE_ACCENT, 0.95))):
            frusta = cameras.find_frusta()[chosen]
            pen.draw_lines(_list_edges(frusta), color)
            for index, apex in zip(chosen.tolist(), pen.project_all(frusta[:, 0]), strict=True):
                if apex is not None:
                    draw.add_circle_filled(ImVec2(*apex), scale_pixels(DOT), color)
                    ui.mark_spot(f"gizmo.camera.{index}", apex, DOT, place)
        draw.pop_clip_rect()
        self._draw_label(ui, place)

    def _draw_way(self, ui: Ui, pen: WorldPen) -> None:
        way = ui.session.cameras.find_way()
        if way is not None:
            pen.draw_path(way, pack_color(PICTURE_ACCENT, 0.6))

    def _draw_label(self, ui: Ui, place: Rectangle) -> None:
        """Name the camera under the mouse and its moment, beside the pointer and inside the picture."""
        index, document = ui.session.state.hovered_camera, ui.session.document
        if index is None or document is None or ui.pointer is None:
            return
        view, draw = document.scene.views[index], imgui.get_window_draw_list()
        name = phrase(
            "{camera}, step {step}, {time:.2f} s: click to look through it",
            camera=view.name.replace("_", " "),
            step=view.index,
            time=view.time,
        )
        text, pad, gap = translate(name), scale_pixels(6), scale_pixels(16)
        size = imgui.calc_text_size(text)
        x, y = place.locate_pixel(*ui.pointer)
        left = min(x + gap, place.x + place.width - size.x - 2 * pad)
        top = min(y + gap, place.y + place.height - size.y - 2 * pad)
        low, high = ImVec2(left - pad, top - pad), ImVec2(left + size.x + pad, top + size.y + pad)
        draw.add_rect_filled(low, high, pack_color(PICTURE_SHADE, 0.9), scale_pixels(4))
        draw.add_text(ImVec2(left, top), pack_color(PICTURE_TEXT), text)
        ui.marks["gizmo.camera_label"] = (low.x, low.y, high.x, high.y)


def _list_edges(frusta: Float64[ndarray, "n 5 3"]) -> Float64[ndarray, "m 2 3"]:
    """Both ends of the eight edges of each frustum."""
    return frusta[:, EDGES].reshape(-1, 2, 3)
