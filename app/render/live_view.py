"""The viewport's picture of whatever document is open, and what the cursor is on."""

from __future__ import annotations

import time

import moderngl

from instdrive_app.render.renderer import Renderer
from instdrive_app.state import EditorState, FrameSnapshot, resolve
from instdrive_core.edits.document import Document

SMOOTH_SECONDS = 1 / 25
"""Frames that take longer than this are drawn coarsely while the camera moves or the drive plays."""
SETTLE_SECONDS = 0.15
"""A view that has stood still for so long is not moving."""


class LiveView:
    """Owns the renderer of the present document."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self._ctx = ctx
        self._renderer: Renderer | None = None
        self._document: Document | None = None
        self._sharp_seconds = 0.0
        self._moved_at = 0.0
        self._last_look: tuple[bytes, float] | None = None
        self.snapshot: FrameSnapshot | None = None
        """The last frame shown."""
        self.frame_seconds = 0.0
        """How long the last frame that had to be drawn took."""

    @property
    def backend(self) -> str:
        """The graphics driver's name for the device."""
        return self._ctx.info["GL_RENDERER"].split("(")[0].strip()

    @property
    def renderer(self) -> Renderer:
        """The renderer of the document shown last."""
        assert self._renderer is not None, "nothing was shown yet"
        return self._renderer

    @property
    def settled(self) -> bool:
        """Whether the picture is sharp: nothing is left to be drawn."""
        return self.snapshot is not None and not self.snapshot.draft

    def show(self, document: Document, state: EditorState, width: int, height: int) -> moderngl.Texture:
        """The picture of a viewport of this size; drawn only where something has changed."""
        if document is not self._document:
            self.release()
            self._renderer, self._document = Renderer(self._ctx, document), document
        self.renderer.free_retired()
        self.snapshot = resolve(state, width, height, draft=self._is_draft(state))
        before, started = self.renderer.blended_draws, time.perf_counter()
        self.renderer.render(self.snapshot)
        if self.renderer.blended_draws != before:
            self._ctx.finish()
            self.frame_seconds = time.perf_counter() - started
            if not self.snapshot.draft:
                self._sharp_seconds = self.frame_seconds
        return self.renderer.picture

    def depth_at(self, x: float, y: float) -> float | None:
        """Depth (metres along the viewing axis) of the splat that the ID view shows at a pixel; None where none is."""
        if self._renderer is None or self.snapshot is None or self.snapshot.draft:
            return None
        row = self._renderer.row_at(self.snapshot, int(x), int(y))
        if row is None:
            return None
        axis = self.snapshot.camera.camera_from_world[2]
        return float(self._renderer.scene.means[row] @ axis[:3] + axis[3])

    def release(self) -> None:
        """Free everything on the GPU."""
        if self._renderer is not None:
            self._renderer.release()
        self._renderer = self._document = self.snapshot = None

    def _is_draft(self, state: EditorState) -> bool:
        now, look = time.monotonic(), (state.viewpoint.world_from_camera.tobytes(), state.time)
        if look != self._last_look:
            if self._last_look is not None:
                self._moved_at = now
            self._last_look = look
        return now - self._moved_at < SETTLE_SECONDS and self._sharp_seconds > SMOOTH_SECONDS
