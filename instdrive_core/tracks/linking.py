"""Clusters linked over time: which cluster of the next sweep is the same thing."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float64, Int64
from numpy import ndarray
from scipy.optimize import linear_sum_assignment

from instdrive_core.tracks.candidates import Cluster
from instdrive_core.tracks.nearest import align, sample_evenly

MAX_SPEED = 35.0
"""Metres per second."""
COASTING = 0.65
"""Seconds for which a thing that is not met stays looked for."""
MAX_DEVIATION, DEVIATION_PER_SECOND = 1.0, 4.0
"""Metres that a cluster may lie off the place its motion leads to, right after it was seen and more per second."""
SIZE_WEIGHT, HEIGHT_WEIGHT = 0.5, 0.5
"""Metres of displacement that a metre of difference in extent along the ground, or in height, counts as."""
MAX_COST = 3.5
SAMPLE = 120
"""Points of a cluster that a displacement is settled by."""
SLIVER, NEARBY = 0.12, 5
"""Share of the points of most clusters around, and how many of these before and after, below which one is a sliver."""
BLEND = 0.5
"""Weight of the newest displacement in a velocity."""


@dataclass(eq=False)
class Chain:
    """A thing as it is followed from sweep to sweep."""

    clusters: list[Cluster]
    shifts: list[Float64[ndarray, "2"]] = field(default_factory=list)
    """Metres along the ground from each cluster to the next."""
    velocity: Float64[ndarray, "2"] = field(default_factory=lambda: np.zeros(2))
    """Metres per second, at the last cluster."""

    @property
    def is_new(self) -> bool:
        """Whether its velocity is unknown."""
        return len(self.clusters) < 2

    def place_at(self, time: float) -> Float64[ndarray, "2"]:
        """Where the middle of the last cluster will be."""
        return self.clusters[-1].middle + self.velocity * (time - self.clusters[-1].time)


def link_sightings(by_sweep: list[list[Cluster]]) -> list[Chain]:
    """Chains of clusters of sweeps in order of time, each cluster in one of them at most; brief slivers are in none."""
    ended: list[Chain] = []
    active: list[Chain] = []
    for found in by_sweep:
        if not found:
            continue
        now = float(np.median([one.time for one in found]))
        ended += [chain for chain in active if now - chain.clusters[-1].time > COASTING]
        active = [chain for chain in active if now - chain.clusters[-1].time <= COASTING]
        taken = _extend(active, found)
        active += [Chain([one]) for number, one in enumerate(found) if number not in taken]
    return [part for chain in ended + active for part in part_at_slivers(chain)]


def _extend(active: list[Chain], found: list[Cluster]) -> set[int]:
    """Append to chains, in place, the clusters that follow; returns their numbers."""
    if not active or not found:
        return set()
    cost = _costs(active, found)
    taken = set()
    for row, column in zip(*linear_sum_assignment(np.minimum(cost, 2 * MAX_COST)), strict=True):
        if cost[row, column] < MAX_COST:
            _append(active[row], found[column])
            taken.add(int(column))
    return taken


def _costs(active: list[Chain], found: list[Cluster]) -> Float64[ndarray, "a b"]:
    """Metres by which each cluster is unlikely to follow each chain, infinity where it cannot."""
    times = np.array([one.time for one in found])
    gap = times[None] - np.array([chain.clusters[-1].time for chain in active])[:, None]
    lows, highs = (np.array([getattr(chain.clusters[-1], side) for chain in active]) for side in ("low", "high"))
    low, high = (np.array([getattr(one, side) for one in found]) for side in ("low", "high"))
    velocity = np.array([chain.velocity for chain in active])
    moved = velocity[:, None] * gap[..., None]
    # Of a half-hidden thing, one edge at least keeps its place: the nearer ones count.
    low_off = low[None, :, :2] - lows[:, None, :2] - moved
    high_off = high[None, :, :2] - highs[:, None, :2] - moved
    middle_off = (low_off + high_off) / 2
    off = np.minimum(np.minimum(np.abs(low_off), np.abs(high_off)), np.abs(middle_off))
    distance = 0.5 * np.linalg.norm(off, axis=2) + 0.5 * np.linalg.norm(middle_off, axis=2)
    extent = (highs - lows)[:, None], (high - low)[None]
    growth = np.abs(extent[1] - extent[0])[..., :2].sum(axis=2)
    height = np.abs(high[None, :, 2] - highs[:, None, 2])
    new = np.array([chain.is_new for chain in active])
    slack = MAX_DEVIATION + DEVIATION_PER_SECOND * np.abs(gap)
    limit = np.where(new[:, None], np.minimum(MAX_SPEED * np.abs(gap), 3.5) + 0.5, slack)
    cost = distance + SIZE_WEIGHT * np.minimum(growth, 4) + HEIGHT_WEIGHT * height
    return np.where(distance <= limit, cost, np.inf)


def _append(chain: Chain, found: Cluster) -> None:
    last = chain.clusters[-1]
    gap = max(found.time - last.time, 1e-3)
    shift = _shift_between(last, found, chain.velocity * gap, chain.is_new)
    newest = shift / gap
    speed = float(np.linalg.norm(newest))
    newest *= min(1.0, MAX_SPEED / max(speed, 1e-6))
    chain.velocity = newest if chain.is_new else (1 - BLEND) * chain.velocity + BLEND * newest
    chain.shifts.append(shift)
    chain.clusters.append(found)


def _shift_between(
    last: Cluster, found: Cluster, predicted: Float64[ndarray, "2"], is_new: bool
) -> Float64[ndarray, "2"]:
    """The displacement of the best alignment, from the prediction and from the middles."""
    first, second = sample_evenly(last.points, SAMPLE), sample_evenly(found.points, SAMPLE)
    middles = found.middle - last.middle
    guesses = [middles] if is_new or np.linalg.norm(middles - predicted) < 0.1 else [predicted, middles]
    return min((align(first, second, guess) for guess in guesses), key=lambda result: result[1])[0]


def part_at_slivers(chain: Chain) -> list[Chain]:
    """A chain without the clusters that show a sliver of what others around them show: where the rest looks as if it
    stood, or hides, the sliver's place says little of the thing's.

    Slivers that last longer than a thing stays looked for are a chain for themselves, and so is what comes after them.
    """
    counts, times = np.array([len(one.rows) for one in chain.clusters]), np.array([one.time for one in chain.clusters])
    kept, slivers = _set_slivers_apart(counts)
    if not len(slivers):
        return [chain]
    runs = [run for run in np.split(slivers, np.flatnonzero(np.diff(slivers) > 1) + 1) if np.ptp(times[run]) > COASTING]
    parts = np.split(kept, np.flatnonzero(np.diff(times[kept]) > COASTING) + 1)
    ways = np.concatenate([np.zeros((1, 2)), np.cumsum(np.array(chain.shifts).reshape(-1, 2), axis=0)])
    return [
        Chain([chain.clusters[k] for k in part], list(np.diff(ways[part], axis=0)), chain.velocity)
        for part in sorted([*parts, *runs], key=lambda part: int(part[0]))
    ]


def _set_slivers_apart(counts: Int64[ndarray, " k"]) -> tuple[Int64[ndarray, " m"], Int64[ndarray, " n"]]:
    """Positions of the clusters that show enough of a thing, and of its slivers: those beside the others first, then
    those that are beside the others now."""
    kept = np.arange(len(counts))
    while True:
        left = counts[kept]
        around = [left[max(0, k - NEARBY) : k + NEARBY + 1] for k in range(len(left))]
        whole = left >= SLIVER * np.array([np.median(np.sort(own)[-NEARBY:]) for own in around])
        if whole.all():
            return kept, np.setdiff1d(np.arange(len(counts)), kept)
        kept = kept[whole]
