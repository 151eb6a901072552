"""Selecting by a line drawn by hand."""

from __future__ import annotations

from instdrive_app.pointer import Point
from instdrive_app.tools.region import RegionTool

STEP = 2.0
"""Pixels that the pointer moves before the line gets another corner."""


class LassoTool(RegionTool):
    """The region is what the pointer's path, closed by a straight line, runs around."""

    def drag(self, start: Point, to: Point) -> None:
        """Add the pointer's place to the path."""
        path = self.outline or (start,)
        last = path[-1]
        if abs(to[0] - last[0]) + abs(to[1] - last[1]) >= STEP:
            path = (*path, to)
        self.outline = path
