"""What the pixels of a still view stand for, found by the CPU rasterizer beside the window.

A pixel stands for the instance that gives it most of its light (`rasterize.preview.PickRule`). OpenGL 3.3 blends
without telling who took part, so a GPU cannot find it; the rasterizer that answers clicks finds it for all pixels at
once. Outlines, lassos, views of instances and clicks agree, on a GPU as without one.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import replace

from jaxtyping import Int32
from numpy import ndarray

from instdrive_app.render.shown_frame import drop_winners
from instdrive_app.render.software.draw import DrawnFrame, FrameRequest, SoftwareDraw
from instdrive_app.render.software.scene import SceneWatcher
from instdrive_app.render.software.thread import LatestFrame
from instdrive_app.state import SPLAT_MODES, FrameSnapshot, ViewMode
from instdrive_core.edits.document.document import Document


class WinnerFrames:
    """Finds the splat of every pixel of one document's views; nothing is done before the first view is asked for."""

    def __init__(self, document: Document, wake: Callable[[], None] = lambda: None) -> None:
        """`wake` is called from another thread when an answer is ready."""
        self._watcher, self._wake = SceneWatcher(document), wake
        self._thread: LatestFrame[FrameRequest, DrawnFrame] | None = None
        self._asked: tuple[Hashable, FrameRequest] | None = None
        self._answer: tuple[Hashable, Int32[ndarray, "h w"]] | None = None

    def find(self, snapshot: FrameSnapshot, key: Hashable, wait: bool) -> Int32[ndarray, "h w"] | None:
        """Find the row of the splat that each pixel stands for, -1 for none.

        Without `wait` it is None until the answer is there; ask again then.

        Raises what drawing raised.

        Args:
            key: equal for snapshots and states of the document whose pixels stand for the same.
        """
        if self._answer is not None and self._answer[0] == key:
            return self._answer[1]
        thread = self._thread = self._thread or LatestFrame(SoftwareDraw(), self._wake)
        if self._asked is None or self._asked[0] != key:
            request = FrameRequest(self._watcher.take_state(), _make_plain(snapshot))
            self._asked = key, request
            thread.ask(request)
        try:
            drawn = thread.wait() if wait else thread.take()
        except BaseException:
            self._asked = None
            raise
        if drawn is not None and drawn.request is self._asked[1]:
            self._answer = key, drawn.winner
            return drawn.winner
        return None

    def release(self) -> None:
        """End the thread."""
        if self._thread is not None:
            self._thread.close()


def _make_plain(snapshot: FrameSnapshot) -> FrameSnapshot:
    """Make a snapshot that stands for the same and is drawn with nothing on top."""
    mode = snapshot.view_mode if snapshot.view_mode in SPLAT_MODES else ViewMode.COLOR
    return replace(drop_winners(snapshot), view_mode=mode, draft=False, hovered=0, show_outlines=False, show_sky=False)
