"""The closed body of a thing that is symmetric across a vertical plane: what bounds it where nothing of it was seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray
from scipy.ndimage import median_filter

from instdrive_core.edits.queries.symmetry import Symmetry

STEP = 0.08
"""Metres between neighbouring places of a skin, about."""
_REACH = 0.15
"""Metres before and behind a cross-section within which points belong to it."""
_FEWEST = 12
"""Points from which the outline of a cross-section can be told."""
_OUTLIERS = 0.03
"""Share of a cross-section's points that may lie outside its outline."""
_ENDS = 0.01
"""Share of all points that may lie before the first and behind the last cross-section."""
_SMOOTHED = 11
"""Neighbouring cross-sections of which the median counts, so that a mirror or an aerial makes no ring."""
_LOWEST = 0.3
"""Height of a cross-section, at least, metres: what is lower is a shadow on the ground."""
_DIRECTIONS = 32
_UP, _DOWN = _DIRECTIONS // 4, 3 * _DIRECTIONS // 4
_ANGLES = np.arange(_DIRECTIONS) * 2 * np.pi / _DIRECTIONS
_OUTWARD = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1)
"""Directions in which the extent of a cross-section is measured: to the left and up."""


@dataclass(frozen=True)
class Skin:
    """Places on a closed surface, and the small patch around each."""

    places: Float64[ndarray, "n 3"]
    """Metres."""
    along: Float64[ndarray, "n 3"]
    """Half of the patch's first side as a vector, metres."""
    around: Float64[ndarray, "n 3"]
    """Half of its second side; not always at right angles to the first."""

    def __len__(self) -> int:
        return len(self.places)

    def select(self, chosen: Int64[ndarray, " k"] | Bool[ndarray, " n"]) -> Skin:
        """Keep some places (indices or a mask)."""
        return Skin(self.places[chosen], self.along[chosen], self.around[chosen])


@dataclass(frozen=True)
class ClosedBody:
    """Cross-sections along a vertical plane of symmetry, each an intersection of half-planes."""

    plane: Symmetry
    stations: Float64[ndarray, " s"]
    """Metres from the plane's point along its heading."""
    extents: Float64[ndarray, "s 32"]
    """How far each cross-section reaches in 32 directions, from the plane's point at height 0, metres."""

    def measure_outside(self, points: Float64[ndarray, "n 3"]) -> Float64[ndarray, " n"]:
        """How far points lie outside of the body, metres; below 0 inside."""
        if not len(self.stations):
            return np.full(len(points), np.inf)
        local = _to_local(points, self.plane)
        row = np.clip(np.round((local[:, 0] - self.stations[0]) / STEP), 0, len(self.stations) - 1).astype(int)
        beside = (local[:, 1:] @ _OUTWARD.T - self.extents[row]).max(axis=1)
        beyond = np.maximum(self.stations[0] - local[:, 0], local[:, 0] - self.stations[-1])
        return np.maximum(beside, beyond)

    def build_skin(self, inset: float) -> Skin:
        """Build the skin that lies `inset` metres inside of the body, with lids at both ends."""
        if not len(self.stations):
            return Skin(*np.zeros((3, 0, 3)))
        inner = (self.stations >= self.stations[0] + inset) & (self.stations <= self.stations[-1] - inset)
        stations, extents = self.stations[inner], self.extents[inner] - inset
        if len(stations) < 2:
            return Skin(*np.zeros((3, 0, 3)))
        parts = [_build_rings(stations, extents), *(_build_lid(stations[row], extents[row]) for row in (0, -1))]
        axes, origin = _frame(self.plane)
        places, along, around = (np.concatenate(vectors) @ axes for vectors in zip(*parts, strict=True))
        return Skin(places + origin, along, around)


def find_body(points: Float64[ndarray, "n 3"], plane: Symmetry) -> ClosedBody:
    """Find the closed body around solid splats (`points`: metres, z up) and their mirror images.

    Cross-sections of vehicles are nearly convex: each becomes the intersection of half-planes that hold all but a few
    of its points. Where a thing was hidden, its outline goes straight from what was seen on one side to the other.
    """
    local = _to_local(points, plane)
    local = np.concatenate([local, local * [1, -1, 1]])
    local = local[np.argsort(local[:, 0], kind="stable")]
    first, last = np.quantile(local[:, 0], [_ENDS, 1 - _ENDS]) if len(local) else (0.0, 0.0)
    stations = np.arange(first, last + 1e-9, STEP)
    extents = np.full((len(stations), _DIRECTIONS), np.nan)
    starts, ends = (np.searchsorted(local[:, 0], stations + shift) for shift in (-_REACH, _REACH))
    for row in np.flatnonzero(ends - starts >= 2 * _FEWEST):
        section = local[starts[row] : ends[row], 1:]
        extents[row] = np.quantile(section @ _OUTWARD.T, 1 - _OUTLIERS, axis=0)
    heights = extents[:, _UP] + extents[:, _DOWN]
    known = np.flatnonzero(heights >= _LOWEST)
    if len(known) < 2:
        return ClosedBody(plane, np.zeros(0), np.zeros((0, _DIRECTIONS)))
    rows = np.arange(known[0], known[-1] + 1)
    bridged = np.stack([np.interp(rows, known, column[known]) for column in extents.T], axis=1)
    return ClosedBody(plane, stations[rows], median_filter(bridged, (_SMOOTHED, 1), mode="nearest"))


def _frame(plane: Symmetry) -> tuple[Float64[ndarray, "3 3"], Float64[ndarray, "3"]]:
    """Unit vectors along the plane, to its left and up, and its point."""
    along = [np.cos(plane.heading), np.sin(plane.heading), 0.0]
    return np.array([along, [*plane.normal, 0.0], [0.0, 0.0, 1.0]]), np.array([*plane.place, 0.0])


def _to_local(points: Float64[ndarray, "n 3"], plane: Symmetry) -> Float64[ndarray, "n 3"]:
    axes, origin = _frame(plane)
    return (points - origin) @ axes.T


def _build_rings(
    stations: Float64[ndarray, " s"], extents: Float64[ndarray, "s 32"]
) -> tuple[Float64[ndarray, "k 3"], Float64[ndarray, "k 3"], Float64[ndarray, "k 3"]]:
    """Places, and halves of the ways to their neighbours in the next cross-sections and in their own."""
    middles = (extents[:, _UP] - extents[:, _DOWN]) / 2
    reach = float(np.median(np.maximum(extents[:, 0], (extents[:, _UP] + extents[:, _DOWN]) / 2)))
    angles = np.linspace(0, 2 * np.pi, 4 * max(2, round(np.pi / 2 * reach / STEP)), endpoint=False)
    rays = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    facing = rays @ _OUTWARD.T
    room = np.maximum(extents - middles[:, None] * _OUTWARD[:, 1], 0.0)
    ways = np.where(facing > 1e-3, room[:, None] / np.maximum(facing, 1e-3), np.inf)
    ring = ways.min(axis=2)[..., None] * rays
    ring[..., 1] += middles[:, None]
    places = np.concatenate([np.broadcast_to(stations[:, None, None], (*ring.shape[:2], 1)), ring], axis=2)
    along = np.gradient(places, axis=0) / 2
    around = (np.roll(places, -1, axis=1) - np.roll(places, 1, axis=1)) / 4
    return places.reshape(-1, 3), along.reshape(-1, 3), around.reshape(-1, 3)


def _build_lid(
    station: float, outline: Float64[ndarray, "32"]
) -> tuple[Float64[ndarray, "k 3"], Float64[ndarray, "k 3"], Float64[ndarray, "k 3"]]:
    """A cross-section filled with patches."""
    left, top, right, bottom = outline[::_UP].tolist()
    across = np.linspace(-right, left, 2 + max(0, int((right + left) / STEP)))
    up = np.linspace(-bottom, top, 2 + max(0, int((bottom + top) / STEP)))
    cells = np.stack(np.meshgrid(across, up, indexing="ij"), axis=2).reshape(-1, 2)
    cells = cells[(cells @ _OUTWARD.T <= outline).all(axis=1)]
    flat = np.ones((len(cells), 1))
    return np.c_[station * flat, cells], flat * [0.0, STEP / 2, 0.0], flat * [0.0, 0.0, STEP / 2]
