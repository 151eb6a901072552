"""Which other photos tell most of a photo's depths."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int64
from numpy import ndarray

from instdrive_core.scene.camera import Camera

MOST_PARTNERS = 4
"""Photos that one is compared with; more cost time."""
_WIDEST_TURN = np.cos(np.radians(50))
"""Photos that look farther apart hardly show the same."""
_RANKS = (0, 2, 6, 14)
"""Places in the order by distance of those that are partners while no depth is known: some close by, some with more
parallax."""
_BEST_ANGLE, _WIDEST_ANGLE = np.radians(7), np.radians(35)
"""Angle between two photos' rays at which depth is best told, and from which on nothing looks alike any more."""
_LEAST_SHARED = 0.2
"""Share of a photo that a partner must show."""


def list_near_partners(cameras: Sequence[Camera]) -> list[Int64[ndarray, " k"]]:
    """List for each camera a few that stand close by and look the same way, nearest first; none may be there."""
    places = np.stack([camera.position for camera in cameras])
    forward = np.stack([camera.world_from_camera[:3, 2] for camera in cameras])
    chosen = []
    for number in range(len(cameras)):
        away = np.linalg.norm(places - places[number], axis=1)
        fits = (forward @ forward[number] > _WIDEST_TURN) & (away > 1e-6 * max(1.0, away.max()))
        order = np.flatnonzero(fits)[np.argsort(away[fits], kind="stable")]
        chosen.append(order[[rank for rank in _RANKS if rank < len(order)]])
    return chosen


def choose_partners(cameras: Sequence[Camera], points: Sequence[Float[ndarray, "p 3"]]) -> list[Int64[ndarray, " k"]]:
    """Choose for each camera the `MOST_PARTNERS` that show most of what it shows from a good distance aside.

    Args:
        cameras: of all photos.
        points: some points that each photo shows, spread over it, metres.
    """
    places = np.stack([camera.position for camera in cameras])
    forward = np.stack([camera.world_from_camera[:3, 2] for camera in cameras])
    chosen = []
    for number, seen in enumerate(points):
        scores = np.zeros(len(cameras))
        if len(seen):
            own = _directions(seen, places[number])
            for other in np.flatnonzero(forward @ forward[number] > _WIDEST_TURN).tolist():
                if other == number:
                    continue
                pixels, depths = cameras[other].project(seen)
                shows = cameras[other].contains(pixels, depths, 0.0)
                angles = np.arccos(np.clip((own * _directions(seen, places[other])).sum(axis=1), -1, 1))
                worth = np.minimum(angles / _BEST_ANGLE, (_WIDEST_ANGLE - angles) / (_WIDEST_ANGLE - _BEST_ANGLE))
                if shows.mean() > _LEAST_SHARED:
                    scores[other] = (np.clip(worth, 0, 1) * shows).mean()
        order = np.argsort(-scores, kind="stable")[:MOST_PARTNERS]
        chosen.append(order[scores[order] > 0])
    return chosen


def _directions(points: Float[ndarray, "p 3"], place: Float[ndarray, "3"]) -> Float[ndarray, "p 3"]:
    away = points - place
    return away / np.linalg.norm(away, axis=1, keepdims=True)
