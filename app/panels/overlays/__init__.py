"""What is drawn over the picture, one file each.

A new overlay is a file and a line in `panels/registry.py`. The lists' order is the order of drawing.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from instdrive_app.panels.widgets.ui import Rectangle, Ui


@runtime_checkable
class Overlay(Protocol):
    """Something over the picture."""

    def draw(self, ui: Ui, place: Rectangle) -> None:
        """Draw one frame; `place` is where the picture is in the window."""
        ...


class Handles(Overlay, Protocol):
    """Something over the picture that the mouse takes hold of, told before the picture is."""

    holds_mouse: bool
    """Whether it has the mouse now: then a press neither moves the camera nor goes to the tool."""
