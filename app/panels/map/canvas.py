"""The map's canvas: where a place of the ground is in the window, lines between places, and what takes presses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from imgui_bundle import ImVec2, imgui
from jaxtyping import Float
from numpy import ndarray

from instdrive_app.panels.widgets.ui import Rectangle, Ui, scale_pixels
from instdrive_app.session.mapping.map_window import MapWindow


@dataclass(frozen=True)
class MapCanvas:
    """A map's window and where it is drawn."""

    window: MapWindow
    place: Rectangle

    def to_screen(self, places: Float[ndarray, "n d"]) -> list[ImVec2]:
        """Convert places (metres) to positions in the program's window."""
        pixels = self.window.to_pixels(places) + np.array([self.place.x, self.place.y])
        return [ImVec2(x, y) for x, y in pixels.tolist()]

    def find_mouse(self) -> tuple[float, float]:
        """Find the place (metres) under the mouse."""
        at = imgui.get_io().mouse_pos
        return self.window.to_place(at.x - self.place.x, at.y - self.place.y)

    def measure_to_mouse(self, place: tuple[float, float]) -> float:
        """Measure from a place to the mouse, in pixels of the window."""
        at, (point,) = imgui.get_io().mouse_pos, self.to_screen(np.array([place]))
        return float(np.hypot(point.x - at.x, point.y - at.y))

    def draw_path(self, places: Float[ndarray, "n d"], color: int, thickness: float, closed: bool = False) -> None:
        """Draw a line through places; thickness in pixels at scale 1."""
        if len(places) > 1:
            flags = imgui.ImDrawFlags_.closed if closed else imgui.ImDrawFlags_.none
            points: list[imgui.ImVec2Like] = [*self.to_screen(places)]
            imgui.get_window_draw_list().add_polyline(points, color, scale_pixels(thickness), flags)

    def fill_shape(self, places: Float[ndarray, "n d"], color: int) -> None:
        """Fill a convex shape with these corners."""
        points: list[imgui.ImVec2Like] = [*self.to_screen(places)]
        imgui.get_window_draw_list().add_convex_poly_filled(points, color)


@runtime_checkable
class MapLayer(Protocol):
    """Something on the map that takes presses of the left button before the map itself does."""

    def draw(self, ui: Ui, canvas: MapCanvas) -> None:
        """Draw one frame over the map."""
        ...

    def press(self, ui: Ui, canvas: MapCanvas) -> bool:
        """Take a press of the left button at the mouse; returns whether it was taken."""
        ...

    def drag(self, ui: Ui, canvas: MapCanvas, is_moved: bool) -> None:
        """Follow the mouse while the taken press lasts; `is_moved`: it has gone far enough to be a drag."""
        ...

    def release(self, ui: Ui, canvas: MapCanvas, is_moved: bool) -> None:
        """End the press that was taken."""
        ...

    def click(self, ui: Ui, canvas: MapCanvas, thing: int) -> bool:
        """Take a click of a press that was not taken; `thing` is the instance there, 0 for none. Returns whether."""
        ...
