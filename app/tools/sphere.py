"""The tool that selects inside a sphere, dragged from its middle outwards."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_app.pointer import Click, Point
from instdrive_app.state import FrameSnapshot
from instdrive_app.tools.region import RegionTool
from instdrive_core.edits.kinds.select_rows import SelectRows
from instdrive_core.edits.queries.region import find_ids_with_share
from instdrive_core.edits.queries.shown_means import compute_shown_means

CORNERS = 48
"""Corners of the circle that stands for the sphere in the picture."""


class SphereTool(RegionTool):
    """Selects what lies in a sphere around the splat where the drag begins; the drag's length is its radius.

    What lies behind or before the sphere stays out.
    """

    options: tuple[str, ...] = ("tool.whole_instances", "tool.single_splats")
    _start: Point | None = None

    def drag(self, start: Point, to: Point) -> None:
        """Draw the circle from the middle to the pointer."""
        self._start = start
        radius = float(np.hypot(to[0] - start[0], to[1] - start[1]))
        angles = np.linspace(0, 2 * np.pi, CORNERS, endpoint=False)
        circle = np.c_[start[0] + radius * np.cos(angles), start[1] + radius * np.sin(angles)]
        self.outline = tuple((x, y) for x, y in circle.tolist())

    def release(self, click: Click, snapshot: FrameSnapshot) -> None:
        """Select what lies inside the sphere, as the state's region options say."""
        start, document, session = self._start, self._session.document, self._session
        if start is not None and self.outline and document is not None:
            found = self._find_sphere(snapshot, start, click)
            if found is None:
                session.messages.info("The sphere needs a splat in its middle; begin the drag on something solid")
            else:
                means, drawn = compute_shown_means(document, snapshot.time, snapshot.camera.lag)
                inside = drawn & (np.linalg.norm(means - found[0], axis=1) <= found[1])
                if session.state.region_splats:
                    session.history.apply(SelectRows(np.flatnonzero(inside), click.mode))
                else:
                    ids = document.scene.instance_ids
                    session.selection.select(find_ids_with_share(ids[inside], ids[drawn]), click.mode)
        self.cancel()

    def cancel(self) -> None:
        """Forget the sphere."""
        super().cancel()
        self._start = None

    def _find_sphere(
        self, snapshot: FrameSnapshot, start: Point, click: Click
    ) -> tuple[Float64[ndarray, "3"], float] | None:
        """Find middle and radius, metres; None where the drag began on nothing."""
        document = self._session.document
        assert document is not None
        winners = self._winners(replace(snapshot, draft=False))
        height, width = winners.shape
        row = int(winners[int(np.clip(start[1], 0, height - 1)), int(np.clip(start[0], 0, width - 1))]) - 1
        if row < 0:
            return None
        means, _ = compute_shown_means(document, snapshot.time, snapshot.camera.lag)
        middle = means[row].astype(np.float64)
        depth = float(snapshot.camera.camera_from_world[2, :3] @ middle + snapshot.camera.camera_from_world[2, 3])
        return middle, float(np.hypot(click.x - start[0], click.y - start[1])) * depth / snapshot.camera.fx
