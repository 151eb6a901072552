"""The keys of the selected thing's way on the ground, and where it would be while one of them is dragged."""

from __future__ import annotations

import numpy as np
from imgui_bundle import ImVec2, imgui

from instdrive_app.panels.overlays.world_pen import WorldPen
from instdrive_app.panels.widgets.theme import pack_color
from instdrive_app.panels.widgets.ui import Rectangle, Ui, scale_pixels
from instdrive_app.preferences.themes import PICTURE_ACCENT, PICTURE_SHADE, PICTURE_TEXT

KEY = 5.5
"""Radius of a key, pixels at scale 1."""


class PathKeysOverlay:
    """Draws line, keys and the ghost of the thing; the tool takes the mouse."""

    def draw(self, ui: Ui, place: Rectangle) -> None:
        """Draw one frame."""
        editor, snapshot = ui.session.ways, ui.view.snapshot
        if snapshot is None or not editor.is_active:
            return
        draw = imgui.get_window_draw_list()
        draw.push_clip_rect(ImVec2(place.x, place.y), ImVec2(place.x + place.width, place.y + place.height), True)
        line = np.asarray(editor.find_line(), np.float64).reshape(-1, 3)
        for thickness, color in ((5.0, pack_color(PICTURE_SHADE, 0.6)), (2.5, pack_color(PICTURE_ACCENT))):
            WorldPen(snapshot.camera, place, thickness).draw_path(line, color)
        pen = WorldPen(snapshot.camera, place, 2.0)
        ghost = editor.find_ghost()
        if ghost is not None:
            corners = np.c_[ghost, np.full(len(ghost), editor.find_ground())]
            pen.draw_lines(np.stack([np.roll(corners, 1, axis=0), corners], axis=1), pack_color(PICTURE_TEXT, 0.9))
        if editor.drives:
            for index, key_place in enumerate(editor.find_places()):
                spot = pen.project(key_place)
                if spot is not None:
                    draw_key(spot, index == editor.chosen)
                    ui.mark_spot(f"gizmo.way.{index}", spot, KEY, place)
        draw.pop_clip_rect()


def draw_key(spot: tuple[float, float], is_chosen: bool) -> None:
    """Draw a key of a way at a position in the program's window."""
    draw, at = imgui.get_window_draw_list(), ImVec2(*spot)
    draw.add_circle_filled(at, scale_pixels(KEY + 2), pack_color(PICTURE_SHADE, 0.85))
    draw.add_circle_filled(at, scale_pixels(KEY), pack_color(PICTURE_ACCENT if is_chosen else PICTURE_TEXT))
