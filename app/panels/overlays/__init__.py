"""Overlays over the viewport's picture, one file each.

A new overlay is a file here and a line in `registry`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar, runtime_checkable

from instdrive_app.panels.widgets.ui import Rectangle, Ui


@runtime_checkable
class Overlay(Protocol):
    """Something drawn over the picture."""

    def draw(self, ui: Ui, place: Rectangle) -> None:
        """Draw one frame, if there is anything to show; `place` is where the picture is in the window."""
        ...


@runtime_checkable
class Handles(Overlay, Protocol):
    """An overlay that the user can grasp; it gets the mouse before the picture does."""

    holds_mouse: bool
    """Whether it has the mouse now: then a press neither moves the camera nor goes to the tool."""


SomeOverlay = TypeVar("SomeOverlay", bound=Overlay, covariant=True)


@dataclass(frozen=True)
class OverlayRecord(Generic[SomeOverlay]):
    """One overlay of the viewport."""

    title: str
    icon: str
    """Name of an icon constant of Font Awesome 6."""
    create: Callable[[], SomeOverlay]
