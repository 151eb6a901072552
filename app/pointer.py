"""What a tool is to the viewport: it is told where the pointer is, where it clicked and what it dragged over."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

from instdrive_app.state import FrameSnapshot
from instdrive_core.edits.kinds.select import SelectMode

Point = tuple[float, float]
"""x, y in pixels of the picture, from its top left."""


Operation = Literal["move", "rotate", "scale"]
"""What handles at the selection do."""


@dataclass(frozen=True)
class Click:
    """A press and release of the left button at one place of the picture (pixels, from its top left)."""

    x: float
    y: float
    shift: bool = False
    ctrl: bool = False
    alt: bool = False

    @property
    def mode(self) -> SelectMode:
        """What the keys ask for: Shift adds, Ctrl removes, both keep of the selection what is meant."""
        return choose_selection_mode(self.shift, self.ctrl)


def choose_selection_mode(shift: bool, ctrl: bool) -> SelectMode:
    """The mode of selecting that these keys stand for."""
    if shift and ctrl:
        return "intersect"
    return "add" if shift else "remove" if ctrl else "replace"


@runtime_checkable
class Tool(Protocol):
    """Turns pointing into commands and edits."""

    drags: bool
    """Whether a drag with the left button is the tool's; otherwise it turns the camera."""
    options: tuple[str, ...]
    """IDs of the commands that the toolbar shows beside it."""
    operation: Operation | None
    """What the handles at the selection do; None where the tool has none."""
    outline: tuple[Point, ...]
    """The closed line that is being dragged; empty while nothing is."""

    def hover(self, x: float, y: float, snapshot: FrameSnapshot) -> None:
        """The pointer is at this place of the frame `snapshot`."""

    def leave(self) -> None:
        """The pointer is not over the picture, or drags."""

    def click(self, click: Click, snapshot: FrameSnapshot) -> int:
        """A click on the frame `snapshot`; returns the instance that was clicked, 0 for none."""
        ...

    def drag(self, start: Point, to: Point) -> None:
        """The left button was pressed at `start` and the pointer is at `to`; told every frame, where `drags`."""

    def release(self, click: Click, snapshot: FrameSnapshot) -> None:
        """The drag has ended at the place of `click`, with the keys of then held."""

    def cancel(self) -> None:
        """Forget the drag under way."""
