"""What photos show moving and the scene does not hold: which photos show it, and where."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Sighting:
    """One photo that shows a moving thing."""

    step: int
    """Time step of the clip."""
    box: tuple[float, float, float, float]
    """Left, top, right and bottom as shares of the photo's width and height."""


@dataclass(frozen=True)
class SeenMover:
    """A thing that moves, as one camera saw it; its pixels were kept out of training."""

    camera: str
    """Name of the camera."""
    sightings: tuple[Sighting, ...]
    """In order of time, at least one."""
    label: str = ""
    """Class, where one is known."""
