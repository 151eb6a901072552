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
        return self.project_all(np.asarray(point)[None])[0]

    def project_all(self, points: Float[ndarray, "n 3"]) -> list[tuple[float, float] | None]:
        """Window positions (pixels) of world points; None for those behind the camera."""
        pixels, depths = self._camera.project(points)
        near = (depths < NEAREST).tolist()
        return [
            None if behind else self._place.locate_pixel(x, y)
            for (x, y), behind in zip(pixels.tolist(), near, strict=True)
        ]

    def draw_line(self, start: Float[ndarray, "3"], end: Float[ndarray, "3"], color: int) -> None:
        """Draw a straight line; the part behind the camera is left out."""
        self.draw_lines(np.stack([start, end])[None], color)

    def draw_lines(self, ends: Float[ndarray, "n 2 3"], color: int) -> None:
        """Draw straight lines of one colour, as `draw_line` does, but hundreds of them in a millisecond."""
        ends = self._clip(ends.astype(np.float64))
        pixels, _ = self._camera.project(ends.reshape(-1, 3))
        draw, locate = imgui.get_window_draw_list(), self._place.locate_pixel
        for x, y, last_x, last_y in pixels.reshape(-1, 4).tolist():
            draw.add_line(ImVec2(*locate(x, y)), ImVec2(*locate(last_x, last_y)), color, self._thickness)

    def draw_path(self, places: Float[ndarray, "n 3"], color: int) -> None:
        """Draw straight lines from each place to the next."""
        self.draw_lines(np.stack([places[:-1], places[1:]], axis=1), color)

    def draw_dashes(self, start: Float[ndarray, "3"], end: Float[ndarray, "3"], color: int) -> None:
        """Draw a dashed line."""
        count = max(int(np.linalg.norm(end - start) / DASH_METRES), 1)
        places = np.linspace(start, end, count + 1)[: (count + 1) // 2 * 2]
        self.draw_lines(places.reshape(-1, 2, 3), color)

    def _clip(self, ends: Float64[ndarray, "n 2 3"]) -> Float64[ndarray, "m 2 3"]:
        """The parts of lines before the camera; lines behind it are left out."""
        axis = self._camera.camera_from_world[2]
        depths = ends @ axis[:3] + axis[3] - NEAREST
        ahead = (depths >= 0).any(axis=1)
        ends, depths = ends[ahead], depths[ahead]
        for end in (0, 1):
            behind = depths[:, end] < 0
            first, last = depths[behind, 0], depths[behind, 1]
            share = (first / (first - last))[:, None]
            ends[behind, end] = ends[behind, 0] + share * (ends[behind, 1] - ends[behind, 0])
        return ends
