"""Lines between world points, drawn over the picture."""

from __future__ import annotations

import numpy as np
from imgui_bundle import ImVec2, imgui
from jaxtyping import Float, Float64
from numpy import ndarray

from instdrive_app.panels.widgets.ui import Rectangle, scale_pixels
from instdrive_core.scene.camera import Camera

NEAREST = 0.05
"""Distance from the camera, in metres, where lines are cut off."""
DASH_METRES = 0.5
"""Length of a dash and of the gap after it."""


class WorldPen:
    """Draws into the present window through a camera whose picture is at `place`."""

    def __init__(self, camera: Camera, place: Rectangle, thickness: float = 1.5) -> None:
        self._camera, self._place, self._thickness = camera, place, scale_pixels(thickness)

    def project(self, point: Float[ndarray, "3"]) -> tuple[float, float] | None:
        """Window position (pixels) of a world point; None behind the camera."""
        pixels, depths = self._camera.project(np.asarray(point)[None])
        if depths[0] < NEAREST:
            return None
        return self._place.locate_pixel(float(pixels[0, 0]), float(pixels[0, 1]))

    def draw_line(self, start: Float[ndarray, "3"], end: Float[ndarray, "3"], color: int) -> None:
        """Draw a straight line; the part behind the camera is left out."""
        ends = self._clip(np.stack([start, end]))
        if ends is None:
            return
        pixels, _ = self._camera.project(ends)
        first, last = (ImVec2(*self._place.locate_pixel(x, y)) for x, y in pixels.tolist())
        imgui.get_window_draw_list().add_line(first, last, color, self._thickness)

    def draw_dashes(self, start: Float[ndarray, "3"], end: Float[ndarray, "3"], color: int) -> None:
        """Draw a dashed line."""
        count = max(int(np.linalg.norm(end - start) / DASH_METRES), 1)
        places = np.linspace(start, end, count + 1)
        for first, last in zip(places[:-1:2], places[1::2], strict=False):
            self.draw_line(first, last, color)

    def _clip(self, ends: Float64[ndarray, "2 3"]) -> Float64[ndarray, "2 3"] | None:
        axis = self._camera.camera_from_world[2]
        near, far = (ends @ axis[:3] + axis[3] - NEAREST).tolist()
        if near < 0 and far < 0:
            return None
        clipped = ends.copy()
        if near < 0 or far < 0:
            clipped[0 if near < 0 else 1] = ends[0] + near / (near - far) * (ends[1] - ends[0])
        return clipped
