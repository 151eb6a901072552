"""The tool that selects by a polygon, corner by corner."""

from __future__ import annotations

import numpy as np

from instdrive_app.pointer import Click, Point
from instdrive_app.state import FrameSnapshot
from instdrive_app.tools.region import RegionTool

CLOSING = 9.0
"""Pixels at scale 1 from the first corner within which a click closes the polygon."""


class PolygonTool(RegionTool):
    """Selects inside a polygon: each click is a corner; Enter, a double click or one on the first corner closes it.

    Drags move the camera, which gives the polygon up.
    """

    drags: bool = False
    _corners: tuple[Point, ...] = ()
    _pose: bytes = b""

    def drag(self, start: Point, to: Point) -> None:
        """Do nothing: drags move the camera."""

    def hover(self, x: float, y: float, snapshot: FrameSnapshot) -> None:
        """Draw the polygon to the pointer."""
        if self._corners and snapshot.camera.world_from_camera.tobytes() != self._pose:
            self.cancel()
        self.outline = (*self._corners, (x, y)) if self._corners else ()
        if not self._corners:
            super().hover(x, y, snapshot)

    def click(self, click: Click, snapshot: FrameSnapshot) -> int:
        """Set a corner, or close the polygon; returns 0."""
        at = (click.x, click.y)
        first = self._corners[0] if self._corners else at
        reach = CLOSING * self._session.state.pixel_scale
        closes = len(self._corners) > 2 and np.hypot(at[0] - first[0], at[1] - first[1]) <= reach
        if closes or (click.double and self._corners):
            self.release(click, snapshot)
            return 0
        self._pose = snapshot.camera.world_from_camera.tobytes()
        self._corners = (*self._corners, at)
        self.outline = (*self._corners, at)
        return 0

    def release(self, click: Click, snapshot: FrameSnapshot) -> None:
        """Close the polygon and select what lies inside; fewer than three corners enclose nothing."""
        self.outline = self._corners if len(self._corners) > 2 else ()
        super().release(click, snapshot)

    def cancel(self) -> None:
        """Forget the corners."""
        super().cancel()
        self._corners = ()
