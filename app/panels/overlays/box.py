"""The box with its handles, while the current tool is the box or while it crops."""

from __future__ import annotations

import numpy as np
from imgui_bundle import ImVec2, imgui

from instdrive_app.panels.overlays.world_pen import WorldPen
from instdrive_app.panels.widgets.theme import pack_color
from instdrive_app.panels.widgets.ui import Rectangle, Ui, scale_pixels
from instdrive_app.preferences.themes import PICTURE_ACCENT, PICTURE_SHADE, PICTURE_TEXT
from instdrive_app.session.aids.box_handles import CENTER, locate_handles
from instdrive_app.session.selection_box import BOX_EDGES

HANDLE, MARK = 6.0, 5.0
"""Radius of a handle, and half the side of its mark; pixels at scale 1."""


class BoxOverlay:
    """Draws edges, a handle in the middle of each face and one in the middle of the box, and its size."""

    def draw(self, ui: Ui, place: Rectangle) -> None:
        """Draw one frame."""
        controller, snapshot = ui.session.aids.box, ui.view.snapshot
        is_held = ui.session.state.tool == "box"
        if controller.box is None or snapshot is None or not (is_held or controller.is_cropping):
            return
        box, camera, draw = controller.box, snapshot.camera, imgui.get_window_draw_list()
        draw.push_clip_rect(ImVec2(place.x, place.y), ImVec2(place.x + place.width, place.y + place.height), True)
        pen = WorldPen(camera, place)
        edges = box.corners[np.array(BOX_EDGES)]
        pen.draw_lines(edges, pack_color(PICTURE_ACCENT, 0.9 if is_held else 0.4))
        for name, (x, y) in locate_handles(box, camera).items() if is_held else ():
            at, radius = ImVec2(*place.locate_pixel(x, y)), scale_pixels(HANDLE)
            draw.add_circle_filled(at, radius + scale_pixels(1.5), pack_color(PICTURE_SHADE, 0.8))
            draw.add_circle_filled(at, radius, pack_color(PICTURE_TEXT if name == CENTER else PICTURE_ACCENT))
            ui.marks[f"gizmo.box.{name}"] = (at.x - MARK, at.y - MARK, at.x + MARK, at.y + MARK)
        draw.pop_clip_rect()
