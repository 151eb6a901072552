"""The base of rectangle and lasso: the user drags a closed line, and what lies inside is selected."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import replace

import numpy as np
from jaxtyping import Bool
from numpy import ndarray

from instdrive_app.pointer import Click, Operation, Point
from instdrive_app.render.picking import Picker
from instdrive_app.session.editor_session import EditorSession
from instdrive_app.state import FrameSnapshot
from instdrive_app.tools.pick import PickTool
from instdrive_app.tools.surface import WinnerReader
from instdrive_core.edits.kinds.select_rows import SelectRows
from instdrive_core.edits.queries.region import find_instances_in_region, find_rows_in_region
from instdrive_core.scene.screen_region import rasterize_polygon


class RegionTool(ABC):
    """Selects what is inside a dragged region; modifier keys count when the drag ends.

    Shift adds, Ctrl removes, both keep only what is inside. A click without a drag picks like the pick tool.
    """

    drags: bool = True
    operation: Operation | None = None
    trail: tuple[Point, ...] = ()
    options: tuple[str, ...] = ("tool.whole_instances", "tool.single_splats", "tool.visible_only")

    def __init__(self, session: EditorSession, winners: WinnerReader, picker: Picker | None = None) -> None:
        self._session, self._winners = session, winners
        self._pick = PickTool(session, picker)
        self.outline: tuple[Point, ...] = ()

    @property
    def ring(self) -> float:
        """No ring."""
        return 0.0

    @abstractmethod
    def drag(self, start: Point, to: Point) -> None:
        """Bring `outline` up to date."""

    def hover(self, x: float, y: float, snapshot: FrameSnapshot) -> None:
        """Hover what is at this position (pixels) of the frame."""
        self._pick.hover(x, y, snapshot)

    def leave(self) -> None:
        """Hover nothing: the cursor is elsewhere."""
        self._pick.leave()

    def click(self, click: Click, snapshot: FrameSnapshot) -> int:
        """Select by a click, like the pick tool; returns the instance, 0 for none."""
        return self._pick.click(click, snapshot)

    def cycle(self, click: Click, snapshot: FrameSnapshot, step: int) -> int:
        """Select what is farther behind at this position, like the pick tool."""
        return self._pick.cycle(click, snapshot, step)

    def release(self, click: Click, snapshot: FrameSnapshot) -> None:
        """Select what lies inside the outline, as the state's region options say."""
        if self.outline and self._session.document is not None:
            camera = snapshot.camera
            region = rasterize_polygon(np.array(self.outline), camera.width, camera.height)
            self._select(region, click, snapshot)
        self.cancel()

    def cancel(self) -> None:
        """Forget the outline."""
        self.outline = ()

    def _select(self, region: Bool[ndarray, "h w"], click: Click, snapshot: FrameSnapshot) -> None:
        session, options = self._session, self._session.state
        document = session.document
        assert document is not None
        place = (document, snapshot.camera, snapshot.time, region)
        # A draft may have fewer pixels than the picture shows.
        winners = self._winners(replace(snapshot, draft=False)) if options.region_visible_only else None
        if options.region_splats:
            session.history.apply(SelectRows(find_rows_in_region(*place, winners), click.mode))
            return
        ids = find_instances_in_region(*place, winners)
        if not ids and click.mode == "intersect":
            session.selection.clear()
        session.selection.select(ids, click.mode)
