"""The way that is drawn for the recording car: clicks on the map set its places, drags move them."""

from __future__ import annotations

import numpy as np
from imgui_bundle import ImVec2, imgui

from instdrive_app.panels.map.canvas import MapCanvas
from instdrive_app.panels.widgets.theme import pack_color
from instdrive_app.panels.widgets.ui import Ui, scale_pixels
from instdrive_app.preferences.themes import PICTURE_SHADE, PICTURE_TEXT, Color
from instdrive_app.session.driving.path_hits import KEY_PIXELS

DRAWN: Color = (0.35, 0.85, 1.0)
"""Colour of the drawn way: another one than that of the recorded way."""
DOT = 5.0
"""Radius of a place, pixels at scale 1."""


class EgoLayer:
    """The line is shown once it is drawn; its places while it is being drawn."""

    def __init__(self) -> None:
        self._held: int | None = None

    def draw(self, ui: Ui, canvas: MapCanvas) -> None:
        """Draw one frame."""
        way = ui.session.ego_way
        line = way.find_line()
        canvas.draw_path(line, pack_color(PICTURE_SHADE, 0.7), 5.0)
        canvas.draw_path(line, pack_color(DRAWN, 1.0 if way.is_drawing else 0.7), 2.5)
        if not way.is_drawing:
            return
        draw = imgui.get_window_draw_list()
        for index, place in enumerate(way.places):
            (spot,) = canvas.to_screen(np.array([place]))
            draw.add_circle_filled(spot, scale_pixels(DOT + 2), pack_color(PICTURE_SHADE, 0.85))
            draw.add_circle_filled(spot, scale_pixels(DOT), pack_color(DRAWN if index else PICTURE_TEXT))
            text, height = f"{index + 1}", imgui.get_text_line_height()
            draw.add_text(ImVec2(spot.x + scale_pixels(DOT + 4), spot.y - height / 2), pack_color(PICTURE_TEXT), text)
            ui.mark_spot(f"gizmo.map.ego.{index}", (spot.x, spot.y), DOT, canvas.place)

    def press(self, ui: Ui, canvas: MapCanvas) -> bool:
        """Take the place under the mouse."""
        way = ui.session.ego_way
        if not way.is_drawing or not way.places:
            return False
        apart = [canvas.measure_to_mouse(place) for place in way.places]
        nearest = int(np.argmin(apart))
        self._held = nearest if apart[nearest] <= scale_pixels(KEY_PIXELS) else None
        return self._held is not None

    def drag(self, ui: Ui, canvas: MapCanvas, is_moved: bool) -> None:
        """Put the held place where the mouse is."""
        way = ui.session.ego_way
        if is_moved and self._held is not None and self._held < len(way.places):
            way.move(self._held, *canvas.find_mouse())

    def release(self, ui: Ui, canvas: MapCanvas, is_moved: bool) -> None:
        """Let the place go."""
        self._held = None

    def click(self, ui: Ui, canvas: MapCanvas, thing: int) -> bool:
        """Set the next place."""
        way = ui.session.ego_way
        if not way.is_drawing:
            return False
        way.add(*canvas.find_mouse())
        return True
