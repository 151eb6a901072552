"""A grid on the ground, whose spacing in metres follows how far the view reaches."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_app.panels.overlays.world_pen import WorldPen
from instdrive_app.panels.widgets.theme import pack_color
from instdrive_app.panels.widgets.ui import Rectangle, Ui
from instdrive_app.preferences.themes import PICTURE_TEXT
from instdrive_app.state import Viewpoint

CELLS = 12
"""Cells to each side of the middle."""
SHARE = 0.12
"""Wanted spacing, relative to the distance of what the view turns about."""
STEPS = (1.0, 2.0, 5.0)
STRONG = 5
"""Every so many lines one is stronger."""


class GridOverlay:
    """Draws lines along the world's axes at the height of the ground below the middle of the view."""

    def __init__(self) -> None:
        self._known: tuple[object, float | None] = (None, None)

    def draw(self, ui: Ui, place: Rectangle) -> None:
        """Draw one frame."""
        snapshot, state, document = ui.view.snapshot, ui.session.state, ui.session.document
        if not state.show_grid or snapshot is None or document is None:
            return
        spacing = choose_grid_spacing(state.viewpoint)
        corner = np.round(state.viewpoint.pivot / (spacing * STRONG)) * spacing * STRONG
        key = (id(document), document.versions.geometry, corner.tobytes())
        if self._known[0] != key:
            self._known = (key, ui.session.navigation.find_ground_height(corner))
        height = self._known[1]
        corner[2] = 0.0 if height is None else height
        pen = WorldPen(snapshot.camera, place, 1.0)
        lines = list_grid_lines(corner, spacing)
        for strong, alpha in ((False, 0.22), (True, 0.55)):
            pen.draw_lines(
                np.array([(start, end) for start, end, is_strong in lines if is_strong == strong]),
                pack_color(PICTURE_TEXT, alpha),
            )


def choose_grid_spacing(viewpoint: Viewpoint) -> float:
    """Choose metres between two lines: 1, 2 or 5 times a power of ten."""
    wanted = max(SHARE * viewpoint.pivot_distance, 1e-3)
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(max(step * power for step in STEPS if step * power <= wanted * 1.0001))


def list_grid_lines(
    middle: Float64[ndarray, "3"], spacing: float
) -> list[tuple[Float64[ndarray, "3"], Float64[ndarray, "3"], bool]]:
    """List the ends (metres) of all lines around `middle`, which is a crossing, and whether each is a strong one."""
    lines, reach = [], CELLS * spacing
    for axis, across in ((0, 1), (1, 0)):
        for number in range(-CELLS, CELLS + 1):
            start, end = middle.copy(), middle.copy()
            start[across] = end[across] = middle[across] + number * spacing
            start[axis], end[axis] = middle[axis] - reach, middle[axis] + reach
            lines.append((start, end, number % STRONG == 0))
    return lines
