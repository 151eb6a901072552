"""Finds out by measuring whether the CPU draws a scene faster than a slow OpenGL driver does."""

from __future__ import annotations

from dataclasses import replace

from instdrive_app.render.frame_renderer import FrameRenderer
from instdrive_app.state import FrameSnapshot

GAIN = 0.8
"""The CPU must draw in less than this share of OpenGL's time to take over: times vary, and edits take it, too."""
_UNSEEN = 1e-6
"""A change of the opacity that no picture shows, but for which a frame is drawn again."""


class RendererTrial:
    """Lets a renderer draw what another one has drawn, twice: the first frame places splats, the second is timed."""

    def __init__(self, rival: FrameRenderer, snapshot: FrameSnapshot, seconds: float) -> None:
        """`seconds` is what the present renderer needs for the sharp frame `snapshot`."""
        self.rival = rival
        self._snapshots = [replace(snapshot, id_opacity=snapshot.id_opacity + _UNSEEN), snapshot]
        self._seconds = seconds

    def find_winner(self) -> bool | None:
        """Whether the rival is faster; None until that is known. Never waits: call it with each window frame."""
        self.rival.render(self._snapshots[0], wait=False)
        if not self.rival.settled:
            return None
        del self._snapshots[0]
        return None if self._snapshots else self.rival.frame_seconds < GAIN * self._seconds
