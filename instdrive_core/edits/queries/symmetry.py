"""The vertical plane across which a thing looks the same, and on which side of it the thing was seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray
from scipy.spatial import KDTree

from instdrive_core.instances.oriented_box import find_main_parts, fit_upright_box

SEARCHED = 1500
"""Splats on which a plane is looked for."""
_NEAR = 0.12
"""Metres (of 4 m of length) from a mirrored splat to another one within which they agree."""
_OFF_PLANE = 0.15
"""Share of half the width within which splats say nothing: they lie on the plane."""
_TURNS = np.radians(np.arange(-8, 9, 1.0))
_SHIFTS = np.arange(-0.35, 0.351, 0.025)
"""Shares of the width by which the plane is moved from the middle of the box."""
_COLOR_WEIGHT = 3.0
"""Distances of splats that differ by 1 in a colour channel, in units of what is near."""
_REACH = 1.5
"""Such distance of a splat and its counterpart at most."""
_LEAST = 30
"""Counterparts from which a plane can be settled."""
_ROUNDS = 4
_FACE = 0.6
"""Share of half the width from which a splat lies on a side."""
_CELL = 0.15
"""Metres of the cells in which the splats of a side are counted."""
_SEEN = 0.6
"""A side with fewer cells than this share of the other one's was not seen."""


@dataclass(frozen=True)
class Symmetry:
    """A vertical plane through a thing, in the frame of its splats."""

    place: tuple[float, float]
    """x and y of a point of it, metres."""
    heading: float
    """Radians from x to the direction along the plane."""
    agreement: float
    """Share of the splats beside it that have a counterpart, 0 … 1."""

    @property
    def normal(self) -> Float64[ndarray, "2"]:
        """Unit vector across the plane, to the left of its heading."""
        return np.array([-np.sin(self.heading), np.cos(self.heading)])

    def measure(self, points: Float64[ndarray, "n 3"]) -> Float64[ndarray, " n"]:
        """Measure how far points lie to the left of the plane, metres."""
        return (points[:, :2] - np.array(self.place)) @ self.normal

    def mirror(self, points: Float64[ndarray, "n 3"]) -> Float64[ndarray, "n 3"]:
        """Mirror points across the plane."""
        mirrored = points.copy()
        mirrored[:, :2] -= 2 * self.measure(points)[:, None] * self.normal
        return mirrored


def find_symmetry(
    points: Float64[ndarray, "n 3"], colors: Float64[ndarray, "n 3"], heading: float | None = None
) -> Symmetry:
    """Find the plane along a thing's longer side across which most of its splats have one of like colour.

    Args:
        points: solid splats, z up, metres.
        colors: RGB of each, 0 … 1.
        heading: where it heads, if that is known (radians from x); then the plane is not turned.
    """
    main = find_main_parts(points)
    points, colors = points[main], colors[main]
    box = fit_upright_box(points, np.zeros((len(points), 3, 3)), heading)
    yaw, turns = box.yaw, _TURNS if heading is None else np.zeros(1)
    search = _Search(points, colors, _NEAR * max(float(box.size[0]) / 4, 0.1), float(box.size[1]))
    middle, best = box.center[:2], Symmetry((float(box.center[0]), float(box.center[1])), yaw, 0.0)
    for turn in turns.tolist():
        across = np.array([-np.sin(yaw + turn), np.cos(yaw + turn)])
        for x, y in (middle + shift * across for shift in _SHIFTS * float(box.size[1])):
            plane = Symmetry((float(x), float(y)), yaw + turn, 0.0)
            agreement = search.measure_agreement(plane)
            if agreement > best.agreement:
                best = Symmetry(plane.place, plane.heading, agreement)
    for _ in range(_ROUNDS):
        best = search.settle(best, turns=heading is None)
    return best


class _Search:
    """Counterparts of mirrored splats."""

    def __init__(
        self, points: Float64[ndarray, "n 3"], colors: Float64[ndarray, "n 3"], near: float, width: float
    ) -> None:
        chosen = np.linspace(0, len(points) - 1, min(len(points), SEARCHED)).astype(int)
        self._points, self._near, self._off = points, near, _OFF_PLANE * width / 2
        self._chosen, self._colors = points[chosen], _COLOR_WEIGHT * colors[chosen]
        self._tree = KDTree(np.c_[points / near, _COLOR_WEIGHT * colors])

    def measure_agreement(self, plane: Symmetry) -> float:
        """Share of the splats beside a plane whose mirrored place has a splat of like colour."""
        found, beside = self._find_counterparts(plane)
        return len(found) / max(np.count_nonzero(beside), 1)

    def settle(self, plane: Symmetry, turns: bool) -> Symmetry:
        """Move a plane, and turn it if it `turns`, so that mirrored splats lie where their counterparts are."""
        found, beside = self._find_counterparts(plane)
        if len(found) < _LEAST:
            return plane
        mirrored, counterparts = plane.mirror(self._chosen[beside])[found[:, 0]], self._points[found[:, 1]]
        along = np.array([np.cos(plane.heading), np.sin(plane.heading)])
        where = (mirrored[:, :2] - np.array(plane.place)) @ along
        # A plane that is off by d puts what it mirrors off by 2 d.
        off = ((counterparts - mirrored)[:, :2] @ plane.normal) / 2
        slope, shift = np.polyfit(where, off, 1) if turns else (0.0, float(np.mean(off)))
        x, y = np.array(plane.place) + shift * plane.normal
        settled = Symmetry((float(x), float(y)), plane.heading + float(np.arctan(slope)), 0.0)
        return Symmetry(settled.place, settled.heading, self.measure_agreement(settled))

    def _find_counterparts(self, plane: Symmetry) -> tuple[Int64[ndarray, "m 2"], Bool[ndarray, " k"]]:
        """Places of matches among those beside the plane and among all, and which of the chosen are beside it."""
        beside = np.abs(plane.measure(self._chosen)) > self._off
        mirrored = np.c_[plane.mirror(self._chosen[beside]) / self._near, self._colors[beside]]
        apart, places = self._tree.query(mirrored, distance_upper_bound=_REACH)
        matched = np.flatnonzero(np.isfinite(apart))
        return np.c_[matched, np.asarray(places)[matched]].astype(np.int64), beside


def find_seen_side(plane: Symmetry, points: Float64[ndarray, "n 3"]) -> int:
    """The side of the plane on which the thing has more surface: 1 left, -1 right, 0 where both have as much."""
    beside = plane.measure(points)
    half = max(float(np.quantile(beside, 0.97)), float(-np.quantile(beside, 0.03)))
    counts = [len(np.unique(np.floor(points[side * beside > _FACE * half] / _CELL), axis=0)) for side in (1, -1)]
    if min(counts) >= _SEEN * max(counts):
        return 0
    return 1 if counts[0] > counts[1] else -1
