"""The interface between the viewport and its tools: pointer positions, clicks and drags."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

from instdrive_app.state import FrameSnapshot
from instdrive_core.edits.kinds.select import SelectMode

Point = tuple[float, float]
"""x, y in pixels of the picture, from its top left."""


Operation = Literal["move", "rotate", "scale"]
"""What the handles at the selection do."""


@dataclass(frozen=True)
class Click:
    """A press and release of the left button at one place of the picture (pixels, from its top left)."""

    x: float
    y: float
    shift: bool = False
    ctrl: bool = False
    alt: bool = False
    double: bool = False
    """Whether it is the second click of a double click."""

    @property
    def mode(self) -> SelectMode:
        """Mode that the held keys ask for: Shift adds, Ctrl removes, both intersect."""
        return choose_selection_mode(self.shift, self.ctrl)


def choose_selection_mode(shift: bool, ctrl: bool) -> SelectMode:
    """Choose the selection mode that held keys ask for."""
    if shift and ctrl:
        return "intersect"
    return "add" if shift else "remove" if ctrl else "replace"


@runtime_checkable
class Tool(Protocol):
    """Turns pointing into actions and edits."""

    drags: bool
    """Whether the tool takes drags with the left button; otherwise they turn the camera."""
    options: tuple[str, ...]
    """IDs of the commands that the toolbar shows beside it."""
    operation: Operation | None
    """What the handles at the selection do; None where the tool has none."""
    outline: tuple[Point, ...]
    """The closed line that is being dragged; empty while nothing is."""
    trail: tuple[Point, ...]
    """The line that a brush has painted along; empty while it does not."""

    @property
    def ring(self) -> float:
        """Radius in pixels of the ring around the pointer; 0 = none."""
        ...

    def hover(self, x: float, y: float, snapshot: FrameSnapshot) -> None:
        """Handle the pointer at this position in the frame `snapshot`."""

    def leave(self) -> None:
        """Handle the pointer leaving the picture, or beginning a drag."""

    def click(self, click: Click, snapshot: FrameSnapshot) -> int:
        """Handle a click on the frame `snapshot`; returns the clicked instance, 0 for none."""
        ...

    def cycle(self, click: Click, snapshot: FrameSnapshot, step: int) -> int:
        """Select the instance so many farther behind at a position of the frame; returns it, 0 for none."""
        ...

    def drag(self, start: Point, to: Point) -> None:
        """Handle a drag of the left button from `start` to the pointer at `to`; called every frame, where `drags`."""

    def release(self, click: Click, snapshot: FrameSnapshot) -> None:
        """End the drag at the position of `click`, with the keys held then."""

    def cancel(self) -> None:
        """Cancel the drag in progress."""
