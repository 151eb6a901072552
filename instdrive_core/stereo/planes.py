"""At which depths to look: planes on which photos differ by about a pixel from one to the next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Float64
from numpy import ndarray

from instdrive_core.scene.camera import Camera
from instdrive_core.stereo.pixel_relation import relate_pixels

_FEWEST, _MOST = 32, 160
"""Planes that a photo has at least and at most."""
_GRID = 9
"""Pixels along each side of a photo that stand for all."""
_LEAST_SHOWN = 0.15
"""Planes so near that no partner shows more of them are not looked at."""
_NEAREST = 0.05
"""Depth of the nearest plane at most, in distances to the nearest partner."""
_TRIED = 400
"""Inverse depths along which parallax is measured."""
_COARSEST = 1 / 6
"""Largest step from plane to plane, as a share of the depth, that still tells a depth."""


@dataclass(frozen=True)
class Planes:
    """Planes parallel to a photo, from infinitely far to near."""

    inverse: Float64[ndarray, " d"]
    """Inverse depths, 1 / metres, rising from 0."""

    def __len__(self) -> int:
        return len(self.inverse)

    def look_up(self, chosen: Float32[ndarray, "h w"]) -> Float32[ndarray, "h w"]:
        """Look up the inverse depths of planes by number, fractions included; 0 where a plane is too far off for a
        depth to be told."""
        numbers = np.arange(len(self.inverse))
        found = np.interp(chosen, numbers, self.inverse)
        told = np.gradient(self.inverse) <= _COARSEST * self.inverse
        return np.where(told[np.rint(chosen).astype(np.int64)], found, 0).astype(np.float32)


def choose_planes(camera: Camera, partners: Sequence[Camera], nearest: float | None = None) -> Planes:
    """Choose planes for a photo and its partners.

    Args:
        camera: of the photo.
        partners: cameras of photos that it is compared with.
        nearest: inverse depth of the nearest plane; None = as near as a partner shows a part of it.
    """
    if not len(partners):
        return Planes(np.zeros(0))
    away = min(float(np.linalg.norm(partner.position - camera.position)) for partner in partners)
    if away == 0:
        return Planes(np.zeros(0))
    closest = 1 / (_NEAREST * away) if nearest is None else nearest
    tried = np.concatenate([[0.0], closest * np.geomspace(1e-5, 1, _TRIED)])
    shown, moved = np.zeros(len(tried)), np.zeros(len(tried) - 1)
    for partner in partners:
        places, inside = _trace(camera, partner, tried)
        steps = np.linalg.norm(np.diff(places, axis=0), axis=2)
        both = inside[1:] & inside[:-1]
        moved = np.maximum(moved, (steps * both).sum(axis=1) / np.maximum(both.sum(axis=1), 1))
        shown = np.maximum(shown, inside.mean(axis=1))
    if nearest is None:
        last = int(np.flatnonzero(shown >= _LEAST_SHOWN).max(initial=0))
        if not last:
            return Planes(np.zeros(0))
        tried, moved = tried[: last + 1], moved[:last]
    way = np.concatenate([[0.0], np.cumsum(moved + 1e-9)])
    count = int(np.clip(way[-1], _FEWEST, _MOST))
    return Planes(np.interp(np.linspace(0, way[-1], count), way, tried))


def _trace(
    camera: Camera, partner: Camera, inverse: Float64[ndarray, " d"]
) -> tuple[Float64[ndarray, "d p 2"], Bool[ndarray, "d p"]]:
    """Where pixels of a grid lie in a partner at each inverse depth, and whether in its picture."""
    turn, shift = relate_pixels(camera, partner)
    middles = (np.arange(_GRID) + 0.5) / _GRID
    u, v = np.meshgrid(middles * camera.width, middles * camera.height)
    rays = np.stack([u.ravel(), v.ravel(), np.ones(u.size)], axis=1) @ turn.T
    seen = rays + inverse[:, None, None] * shift
    front = seen[..., 2] > 1e-6
    places = seen[..., :2] / np.where(front, seen[..., 2], 1)[..., None]
    inside = front & ((places >= 0) & (places < [partner.width, partner.height])).all(axis=2)
    return places, inside
