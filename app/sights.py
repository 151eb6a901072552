"""From where photos show a thing: seen from elsewhere, it and what is around it are noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

from instdrive_app.camera import find_main_box, view_from_camera
from instdrive_app.state import Intrinsics, Viewpoint
from instdrive_core.scene.camera import CameraView
from instdrive_core.scene.track import Track

NEAREST = 0.5
"""Metres from the camera below which a photo shows too little of a thing."""
TURN_COST = 0.25
"""Share of what the best photo shows that a view may lack which need not be turned round for it."""
_MOST_LOOKED_AT = 2000


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


def find_overview(
    views: Sequence[CameraView], points: Float[ndarray, "n 3"], forward: Float[ndarray, "3"]
) -> Viewpoint | None:
    """Look like the photo that shows most of the points (at least one), roughly in the direction `forward`.

    Returns None where no photo was taken among the points, as seen from above, or none shows any: what the photos were
    not taken in is better looked at as a thing.
    """
    low, high = find_main_box(points)
    looked_at = points[:: 1 + len(points) // _MOST_LOOKED_AT]
    among = [view for view in views if _is_between(view.camera.position, low, high)]
    shown = [view.camera.contains(*view.camera.project(looked_at), NEAREST) for view in among]
    shares = np.array([each.mean() for each in shown])
    if not shares.any():
        return None
    ahead = np.array([view.camera.world_from_camera[:3, 2] for view in among]) @ forward
    turns = np.arccos(np.clip(ahead, -1, 1)) / np.pi
    best = int(np.argmax(shares - TURN_COST * shares.max() * turns))
    found = view_from_camera(among[best])
    depths = (looked_at[shown[best]] - found.position) @ found.forward
    return replace(found, pivot_distance=float(np.median(depths)))


def _is_between(place: Float[ndarray, "3"], low: Float[ndarray, "3"], high: Float[ndarray, "3"]) -> bool:
    return bool(((place > low) & (place < high))[:2].all())


def _find_place_then(
    middle: Float[ndarray, "3"], track: Track, now: float, then: float
) -> Float64[ndarray, "3"] | None:
    """Find where what is at a place now was then; None where its track does not cover that time."""
    if not track.covers(then):
        return None
    here, there = track.interpolate_poses(np.array([now, then]))
    return there[:3, :3] @ (here[:3, :3].T @ (middle - here[:3, 3])) + there[:3, 3]
