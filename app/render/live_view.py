"""The viewport's picture of the open document, and the depth under the cursor."""

from __future__ import annotations

import time
from collections.abc import Callable

import moderngl
import numpy as np

from instdrive_app.render.frame_keys import SMOOTH_SECONDS
from instdrive_app.render.frame_renderer import (
    FrameRenderer,
    choose_renderer_kind,
    create_renderer,
    create_software_renderer,
    is_kind_forced,
)
from instdrive_app.render.picking import Picker
from instdrive_app.render.renderer_trial import RendererTrial
from instdrive_app.render.shown_frame import ShownFrame
from instdrive_app.render.software.warm_up import start_warm_up
from instdrive_app.state import EditorState, FrameSnapshot, resolve
from instdrive_core.edits.document.document import Document

SETTLE_SECONDS = 0.15
"""Time without movement after which a view counts as still."""


class LiveView:
    """Owns the renderer of the present document."""

    def __init__(self, ctx: moderngl.Context, wake: Callable[[], None] = lambda: None, warms_up: bool = True) -> None:
        """`wake` is called from another thread when `show` has a newer picture to show.

        The first view of a process `warms_up` the CPU's renderer.
        """
        self._ctx, self._wake = ctx, wake
        if warms_up:
            start_warm_up()  # with a GPU, too: the CPU says what its pixels stand for
        self._renderer: FrameRenderer | None = None
        self._picker = Picker()
        self._kind = choose_renderer_kind(ctx.info["GL_RENDERER"])
        self._trial: RendererTrial | None = None
        self._was_tried = False
        self._document: Document | None = None
        self._sharp_seconds = 0.0
        self._moved_at = 0.0
        self._last_look: tuple[bytes, float] | None = None
        self.snapshot: FrameSnapshot | None = None
        """The frame on screen, which may be older than the one asked for; None while there is none of this size."""

    @property
    def backend(self) -> str:
        """The graphics driver's name for the device, or ``CPU`` if the CPU draws."""
        return "CPU" if self._kind == "cpu" else self._ctx.info["GL_RENDERER"].split("(")[0].strip()

    @property
    def gl_error(self) -> str | None:
        """The driver's error since the last call; None if there is none."""
        fault = self._ctx.error
        return None if fault == "GL_NO_ERROR" else fault

    @property
    def document(self) -> Document | None:
        """The document that was shown last."""
        return self._document

    @property
    def renderer(self) -> FrameRenderer:
        """The renderer of the document that was shown last."""
        assert self._renderer is not None, "nothing was shown yet"
        return self._renderer

    @property
    def frame_seconds(self) -> float:
        """Seconds that the last frame took which had to be drawn."""
        return self._renderer.frame_seconds if self._renderer is not None else 0.0

    @property
    def settled(self) -> bool:
        """Whether the picture is sharp and current, so that nothing is left to be drawn."""
        is_sharp = self.snapshot is not None and not self.snapshot.draft
        return is_sharp and self.renderer.settled and self._trial is None

    def show(self, document: Document, state: EditorState, width: int, height: int) -> moderngl.Texture:
        """Return the picture for a viewport of this size (pixels); draws only if something has changed, never waits."""
        if document is not self._document:
            self.release()
            self._renderer, self._document = create_renderer(self._ctx, document, self._wake), document
            self._kind, self._was_tried = choose_renderer_kind(self._ctx.info["GL_RENDERER"]), False
        self._hold_trial()
        renderer = self.renderer
        renderer.free_retired()
        wanted = resolve(state, width, height, draft=self._is_draft(state))
        renderer.render(wanted, wait=False)
        shown = renderer.shown
        same_size = shown is not None and (shown.camera.width, shown.camera.height) == (width, height)
        self.snapshot = shown if same_size else None
        if shown is not None and not shown.draft:
            self._sharp_seconds = renderer.frame_seconds
        self._start_trial(wanted)
        assert renderer.picture is not None, "a frame was just drawn"
        return renderer.picture

    def find_row_at(self, x: float, y: float) -> int | None:
        """Find the splat that a pixel stands for; None where none is, or while the camera moves.

        Frames that do not know it are not read back from the GPU, which would wait for it: the pixel is computed.
        """
        snapshot = self.snapshot
        if self._document is None or snapshot is None or snapshot.draft:
            return None
        row = snapshot.read_row_at(x, y) if isinstance(snapshot, ShownFrame) else None
        row = self._picker.find_row_at(self._document, snapshot, x, y) if row is None else row
        return None if row is None or row < 0 else row

    def measure_depth_at(self, x: float, y: float) -> float | None:
        """Measure the depth (metres along the viewing axis) of the splat that the ID view shows at a pixel, if any."""
        document, snapshot, row = self._document, self.snapshot, self.find_row_at(x, y)
        if document is None or snapshot is None or row is None:
            return None
        poses, _ = document.scene.find_node_poses(snapshot.time, snapshot.camera.lag)
        pose = poses[document.scene.nodes[row]]
        place = pose[:3, :3] @ document.compute_means(np.array([row]))[0] + pose[:3, 3]
        axis = snapshot.camera.camera_from_world[2]
        return float(place @ axis[:3] + axis[3])

    def release(self) -> None:
        """Free everything on the GPU, and end the thread that draws."""
        if self._trial is not None:
            self._trial.rival.release()
        if self._renderer is not None:
            self._renderer.release()
        self._trial = None
        self._renderer = self._document = self.snapshot = None

    def _start_trial(self, shown: FrameSnapshot) -> None:
        """Let the CPU draw the scene, too, where OpenGL takes long: drivers do not say how fast they are."""
        document, renderer = self._document, self.renderer
        if document is None or self._kind == "cpu" or self._was_tried or is_kind_forced() or shown.draft:
            return
        if renderer.settled and renderer.frame_seconds > SMOOTH_SECONDS:
            rival = create_software_renderer(self._ctx, document, self._wake)
            self._trial, self._was_tried = RendererTrial(rival, shown, renderer.frame_seconds), True

    def _hold_trial(self) -> None:
        """Go on with a trial, between two window frames, and let the faster renderer stay."""
        if self._trial is None or self._renderer is None:
            return
        is_faster, rival = self._trial.find_winner(), self._trial.rival
        if is_faster is None:
            return
        self._trial = None
        if is_faster:
            rival, self._renderer, self._kind = self._renderer, rival, "cpu"
        rival.release()

    def _is_draft(self, state: EditorState) -> bool:
        now, look = time.monotonic(), (state.viewpoint.world_from_camera.tobytes(), state.time)
        if look != self._last_look:
            if self._last_look is not None:
                self._moved_at = now
            self._last_look = look
        return now - self._moved_at < SETTLE_SECONDS and self._sharp_seconds > SMOOTH_SECONDS
