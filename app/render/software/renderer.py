"""A renderer for machines whose OpenGL runs on the CPU anyway.

The CPU rasterizer draws the splats on another thread, and OpenGL only shows the picture.
"""

from __future__ import annotations

from collections.abc import Callable

import moderngl
import numpy as np
from jaxtyping import UInt8, UInt32
from numpy import ndarray

from instdrive_app.render.picture_colors import BACKDROP
from instdrive_app.render.shown_frame import ShownFrame, drop_winners
from instdrive_app.render.software.draw import DrawnFrame, FrameRequest, SoftwareDraw
from instdrive_app.render.software.scene import SceneWatcher
from instdrive_app.render.software.thread import LatestFrame
from instdrive_app.state import FrameSnapshot
from instdrive_core.edits.document.document import Document

PACE_SECONDS = 1 / 50
"""Time that each of the window's frames waits while a picture is being drawn, unless the picture arrives earlier. A
window that a software driver draws at full speed would take the cores from the very picture that it is to show."""


class SoftwareRenderer:
    """A `FrameRenderer` without a GPU.

    All methods run on the UI thread; without `wait` none waits for a picture longer than `PACE_SECONDS`.
    """

    def __init__(self, ctx: moderngl.Context, document: Document, wake: Callable[[], None] = lambda: None) -> None:
        """`wake` is called from another thread when a frame asked for without waiting is ready."""
        self._ctx, self._document = ctx, document
        self._watcher = SceneWatcher(document)
        self._thread: LatestFrame[FrameRequest, DrawnFrame] = LatestFrame(SoftwareDraw(), wake)
        self._asked: FrameRequest | None = None
        self._frame: DrawnFrame | None = None
        backdrop = np.array([[*BACKDROP, 1.0]]) * 255
        self._texture = ctx.texture((1, 1), 4, backdrop.round().astype(np.uint8))
        self._retired: list[moderngl.Texture] = []
        self.frame_seconds = 0.0
        """Seconds that the last frame took which had to be blended."""
        self.shown: ShownFrame | None = None
        """The frame that `picture` is; None before the first."""

    @property
    def picture(self) -> moderngl.Texture:
        """The newest frame, RGBA8, row 0 at the top; a draft is smaller than the viewport."""
        return self._texture

    @property
    def settled(self) -> bool:
        """Whether `picture` is what was asked for last."""
        return self._frame is not None and self._frame.request is self._asked

    @property
    def depth_range(self) -> tuple[float, float]:
        """Metres at the near and far end of the depth view's ramp."""
        return self._frame.depth_range if self._frame is not None else (1.0, 100.0)

    def render(self, snapshot: FrameSnapshot, wait: bool = True) -> None:
        """Bring `picture` up to date; without `wait`, only ask for it and show the newest frame there is."""
        state, patience = self._watcher.take_state(), PACE_SECONDS if self._thread.busy else 0.0
        asked = self._asked
        if asked is None or not asked.is_for(state, snapshot):
            self._asked = FrameRequest(state, drop_winners(snapshot))
            self._thread.ask(self._asked)
        drawn = self._thread.wait() if wait else self._thread.take(patience)
        if drawn is not None:
            self._show(drawn)

    def free_retired(self) -> None:
        """Free textures of sizes that are no longer drawn. Call it between window frames."""
        for texture in self._retired:
            texture.release()
        self._retired.clear()

    def read_rows(self, snapshot: FrameSnapshot) -> UInt32[ndarray, "h w"]:
        """Row + 1 of the splat that each pixel stands for; 0 = none."""
        return (self._find_frame(snapshot).winner + 1).astype(np.uint32)

    def read_instance_ids(self, snapshot: FrameSnapshot) -> UInt32[ndarray, "h w"]:
        """The instance that each pixel stands for; 0 = none."""
        frame = self._find_frame(snapshot)
        with_none = np.append(np.uint32(0), frame.request.state.instance_ids)
        return with_none[frame.winner + 1]

    def read_row_at(self, snapshot: FrameSnapshot, x: int, y: int) -> int | None:
        """The splat that a pixel stands for; None where none is, or outside."""
        if not (0 <= x < snapshot.camera.width and 0 <= y < snapshot.camera.height):
            return None
        row = int(self._find_frame(snapshot).winner[y, x])
        return row if row >= 0 else None

    def read_picture(self) -> UInt8[ndarray, "h w 3"]:
        """The newest frame as RGB."""
        assert self._frame is not None, "render was never called"
        return self._frame.picture[..., :3].copy()

    def release(self) -> None:
        """End the thread and free everything on the GPU."""
        self._thread.close()
        self.free_retired()
        self._texture.release()

    def _find_frame(self, snapshot: FrameSnapshot) -> DrawnFrame:
        """Find the frame of a snapshot and the document's present state; draw it unless it is the one on screen."""
        state, frame = self._watcher.take_state(), self._frame
        if frame is None or not frame.request.is_for(state, snapshot):
            self.render(snapshot)
            frame = self._frame
        assert frame is not None, "a frame that was waited for is there"
        return frame

    def _show(self, drawn: DrawnFrame) -> None:
        self._frame, request = drawn, drawn.request
        versions = {"document": self._document, "rows_version": request.state.rows_version}
        self.shown = ShownFrame(**vars(request.snapshot), winner=drawn.winner, **versions)
        if drawn.seconds is not None:
            self.frame_seconds = drawn.seconds
        height, width, _ = drawn.picture.shape
        if self._texture.size != (width, height):
            self._retired.append(self._texture)
            self._texture = self._ctx.texture((width, height), 4)
            self._texture.repeat_x = self._texture.repeat_y = False
        self._texture.write(drawn.picture)
