"""From where photos show a thing: seen from elsewhere, it and what is around it are noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

from instdrive_app.state import Intrinsics
from instdrive_core.scene.camera import CameraView
from instdrive_core.scene.track import Track

NEAREST = 0.5
"""Metres from the camera below which a photo shows too little of a thing."""


@dataclass(frozen=True)
class Sight:
    """The place of a photo that shows a thing."""

    place: Float64[ndarray, "3"]
    """Metres, in the world: from there the surroundings were seen, too."""
    lens: Intrinsics
    driven: float
    """Metres between where the thing was in the photo and where it is now."""


def find_sights(
    views: Sequence[CameraView], middle: Float[ndarray, "3"], track: Track | None = None, time: float = 0.0
) -> tuple[Sight, ...]:
    """Find the photos that show the place `middle` (metres), which stands still, or drives on a track, at `time` (s).

    What hides it in a photo is not asked: framing asks what is before a thing anyway.
    """
    sights = []
    for view in views:
        place = middle if track is None else _find_place_then(middle, track, time, view.time)
        if place is not None and view.camera.contains(*view.camera.project(place[None]), NEAREST)[0]:
            driven = float(np.linalg.norm(place - middle))
            sights.append(Sight(view.camera.world_from_camera[:3, 3], Intrinsics.from_camera(view.camera), driven))
    return tuple(sights)


def _find_place_then(
    middle: Float[ndarray, "3"], track: Track, now: float, then: float
) -> Float64[ndarray, "3"] | None:
    """Find where what is at a place now was then; None where its track does not cover that time."""
    if not track.covers(then):
        return None
    here, there = track.interpolate_poses(np.array([now, then]))
    return there[:3, :3] @ (here[:3, :3].T @ (middle - here[:3, 3])) + there[:3, 3]
