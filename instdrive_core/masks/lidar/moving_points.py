"""Moving points of each sweep: other sweeps looked through them, or motion leads to them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32
from numpy import ndarray

from instdrive_core.masks.lidar.cluster_motion import find_again, link_clusters
from instdrive_core.masks.lidar.see_through import build_range_image, is_seen_through

WITNESSES = 2
"""Sweeps that must have looked through a point's place for it to have moved there."""
MOVED_SHARE = 0.25
"""Share of a cluster's points that must have moved for all of it to be moving."""
MIN_POINTS = 12
"""Smaller clusters are not looked for in other sweeps."""
MAX_LENGTH = 15.0
"""Metres along an axis: larger clusters are not looked for in other sweeps."""


@dataclass(frozen=True)
class ClusteredSweep:
    """One sweep's points and which of them hang together."""

    time: float
    position: Float64[ndarray, "3"]
    """Position of the sensor."""
    points: Float32[ndarray, "n 3"]
    clusters: Int32[ndarray, " n"]
    """Number by point, -1 = ground."""

    def belong_to(self, chosen: Bool[ndarray, " c"]) -> Bool[ndarray, " n"]:
        """Whether each point is of one of the chosen clusters."""
        return np.append(chosen, False)[self.clusters]  # ground, -1, takes the last

    def select_parts(self, chosen: Bool[ndarray, " c"]) -> tuple[list[int], list[Float32[ndarray, "k 3"]]]:
        """Select numbers and points of those chosen clusters that can be compared between sweeps."""
        rows = np.flatnonzero(self.belong_to(chosen))
        order = rows[np.argsort(self.clusters[rows], kind="stable")]
        cuts = np.flatnonzero(np.diff(self.clusters[order])) + 1
        parts = [part for part in np.split(order, cuts) if len(part) >= MIN_POINTS]
        parts = [part for part in parts if np.ptp(self.points[part], axis=0).max() < MAX_LENGTH]
        return [int(self.clusters[part[0]]) for part in parts], [self.points[part] for part in parts]


def find_moving_clusters(sweeps: list[ClusteredSweep]) -> list[Bool[ndarray, " c"]]:
    """Find out, by sweep in order of time, whether each of its clusters moves."""
    moved = _find_seen_through(sweeps)
    steps = range(len(sweeps) - 1)
    for order in ([(step, step + 1) for step in steps], [(step + 1, step) for step in reversed(steps)]):
        for known, other in order:
            _follow_moving(
                sweeps[known], moved[known], _estimate_velocities(sweeps, moved, known), sweeps[other], moved[other]
            )
    return moved


def _find_seen_through(sweeps: list[ClusteredSweep]) -> list[Bool[ndarray, " c"]]:
    """Find clusters through whose place other sweeps looked."""
    images = [build_range_image(one.points, one.position) for one in sweeps]
    witnesses = max(1, min(WITNESSES, len(sweeps) - 1))
    moved = []
    for number, one in enumerate(sweeps):
        rows = np.flatnonzero(one.clusters >= 0)
        votes = np.zeros(len(rows), np.int32)
        for other, image in enumerate(images):
            if other != number:
                votes += is_seen_through(one.points[rows], image)
        count = int(one.clusters.max(initial=-1)) + 1
        sizes = np.bincount(one.clusters[rows], minlength=count)
        moved.append(np.bincount(one.clusters[rows], votes >= witnesses, count) > MOVED_SHARE * sizes)
    return moved


def _estimate_velocities(
    sweeps: list[ClusteredSweep], moved: list[Bool[ndarray, " _"]], step: int
) -> dict[int, Float64[ndarray, "3"]]:
    """Estimate metres per second of a sweep's moving clusters that its neighbours show as well."""
    numbers, parts = sweeps[step].select_parts(moved[step])
    found: dict[int, Float64[ndarray, "3"]] = {}
    if step + 1 < len(sweeps):
        gap = sweeps[step + 1].time - sweeps[step].time
        links = link_clusters(parts, sweeps[step + 1].select_parts(moved[step + 1])[1], gap)
        found |= {numbers[link.first]: link.shift / gap for link in links}
    if step > 0:
        gap = sweeps[step].time - sweeps[step - 1].time
        links = link_clusters(sweeps[step - 1].select_parts(moved[step - 1])[1], parts, gap)
        found |= {numbers[link.second]: link.shift / gap for link in links}
    return found


def _follow_moving(
    known: ClusteredSweep,
    moved: Bool[ndarray, " c"],
    velocities: dict[int, Float64[ndarray, "3"]],
    other: ClusteredSweep,
    moved_there: Bool[ndarray, " d"],
) -> None:
    """Mark, in place, another sweep's clusters that are where a moving one of `known` must be."""
    numbers, parts = known.select_parts(moved)
    others, other_parts = other.select_parts(np.ones(len(moved_there), bool))
    for number, part in zip(numbers, parts, strict=True):
        if number in velocities:
            best = find_again(part, velocities[number], other_parts, other.time - known.time)
            if best is not None:
                moved_there[others[best]] = True
