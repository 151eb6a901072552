"""The tool that selects by a line drawn freehand."""

from __future__ import annotations

from instdrive_app.pointer import Point
from instdrive_app.tools.region import RegionTool

STEP = 2.0
"""Distance, in pixels, after which the line gets another corner."""


class LassoTool(RegionTool):
    """Selects inside the pointer's path, closed by a straight line."""

    def drag(self, start: Point, to: Point) -> None:
        """Add the pointer's position to the path."""
        path = self.outline or (start,)
        last = path[-1]
        if abs(to[0] - last[0]) + abs(to[1] - last[1]) >= STEP:
            path = (*path, to)
        self.outline = path
