"""The tool that selects by painting with a round brush, no deeper than a limit behind what is seen."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float32, UInt32
from numpy import ndarray

from instdrive_app.pointer import Click, Point
from instdrive_app.state import FrameSnapshot
from instdrive_app.tools.region import RegionTool
from instdrive_core.edits.kinds.select_rows import SelectRows
from instdrive_core.edits.queries.brush import mark_stroke, project_for_brush
from instdrive_core.edits.queries.region import NEAR
from instdrive_core.edits.queries.shown_means import compute_shown_means


@dataclass
class Stroke:
    """One press of the brush."""

    projected: Float32[ndarray, "n 3"]
    drawn: Bool[ndarray, " n"]
    winners: UInt32[ndarray, "h w"]
    marks: Bool[ndarray, " n"]
    last: Point
    surface: float = np.inf
    """Depth of what was last seen under the brush's middle, metres."""


class BrushTool(RegionTool):
    """Selects what the brush passes over; in the mode of whole instances, every instance that it touches."""

    options: tuple[str, ...] = (
        "tool.whole_instances",
        "tool.single_splats",
        "tool.visible_only",
        "brush.smaller",
        "brush.larger",
        "brush.shallower",
        "brush.deeper",
    )
    _snapshot: FrameSnapshot | None = None
    _stroke: Stroke | None = None

    @property
    def ring(self) -> float:
        """Radius of the brush, pixels of the picture."""
        return self._session.state.brush_radius * self._session.state.pixel_scale

    def hover(self, x: float, y: float, snapshot: FrameSnapshot) -> None:
        """Hover what is at this position, and keep the frame: a stroke may begin on it."""
        self._snapshot = snapshot
        super().hover(x, y, snapshot)

    def drag(self, start: Point, to: Point) -> None:
        """Paint from where the brush was to the pointer."""
        if self._stroke is None:
            self._stroke = self._begin_stroke(start)
            self.trail, self.outline = (start,), (start,)
            if self._stroke is not None:
                self._paint(self._stroke, start)
        if self._stroke is not None and to != self._stroke.last:
            self._paint(self._stroke, to)
            self.trail = (*self.trail, to)

    def release(self, click: Click, snapshot: FrameSnapshot) -> None:
        """Select what was painted over."""
        stroke, document = self._stroke, self._session.document
        if stroke is not None and document is not None and len(stroke.marks) == len(document.scene):
            marks, state = stroke.marks & stroke.drawn, self._session.state
            if state.region_visible_only:
                seen = np.zeros(len(marks) + 1, np.bool_)
                seen[stroke.winners.ravel()] = True
                marks &= seen[1:]
            rows = np.flatnonzero(marks)
            if state.region_splats:
                self._session.history.apply(SelectRows(rows, click.mode))
            else:
                ids = tuple(np.unique(document.scene.instance_ids[rows]).tolist())
                self._session.selection.select(tuple(number for number in ids if number), click.mode)
        self.cancel()

    def cancel(self) -> None:
        """Forget the stroke."""
        super().cancel()
        self._stroke, self.trail = None, ()

    def _begin_stroke(self, start: Point) -> Stroke | None:
        document, snapshot = self._session.document, self._snapshot
        if document is None or snapshot is None:
            return None
        means, drawn = compute_shown_means(document, snapshot.time, snapshot.camera.lag)
        projected = project_for_brush(means, snapshot.camera, NEAR)
        winners = self._winners(replace(snapshot, draft=False))
        return Stroke(projected, drawn, winners, np.zeros(len(means), np.bool_), start)

    def _paint(self, stroke: Stroke, to: Point) -> None:
        row = _find_nearest_winner(stroke.winners, to, self.ring)
        if row is not None:
            stroke.surface = float(stroke.projected[row, 2])
        deepest = stroke.surface + self._session.state.brush_depth
        mark_stroke(stroke.projected, stroke.last, to, self.ring, deepest, stroke.marks)
        stroke.last = to


def _find_nearest_winner(winners: UInt32[ndarray, "h w"], at: Point, radius: float) -> int | None:
    """Find the splat that the nearest pixel within the brush stands for; None where all of them are empty."""
    reach, (column, row) = int(radius), (int(at[0]), int(at[1]))
    top, left = max(row - reach, 0), max(column - reach, 0)
    part = winners[top : max(row + reach + 1, 0), left : max(column + reach + 1, 0)]
    rows, columns = np.nonzero(part)
    if not len(rows):
        return None
    nearest = np.argmin((rows + top - row) ** 2 + (columns + left - column) ** 2)
    return int(part[rows[nearest], columns[nearest]]) - 1
