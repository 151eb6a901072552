"""What a tool is to the viewport: it is told where the pointer is and where it clicked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from instdrive_app.state import FrameSnapshot


@dataclass(frozen=True)
class Click:
    """A press and release of the left button at one place of the picture (pixels, from its top left)."""

    x: float
    y: float
    shift: bool = False
    ctrl: bool = False
    alt: bool = False


class Tool(Protocol):
    """Turns pointing into commands and edits."""

    def hover(self, x: float, y: float, snapshot: FrameSnapshot) -> None:
        """The pointer is at this place of the frame `snapshot`."""

    def leave(self) -> None:
        """The pointer is not over the picture, or drags."""

    def click(self, click: Click, snapshot: FrameSnapshot) -> int:
        """A click on the frame `snapshot`; returns the instance that was clicked, 0 for none."""
        ...
