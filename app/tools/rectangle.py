"""The tool that selects by a rectangle."""

from __future__ import annotations

from instdrive_app.pointer import Point
from instdrive_app.tools.region import RegionTool


class RectangleTool(RegionTool):
    """Selects inside the rectangle between the drag's ends."""

    def drag(self, start: Point, to: Point) -> None:
        """Span the rectangle."""
        self.outline = (start, (to[0], start[1]), to, (start[0], to[1]))
