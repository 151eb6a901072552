"""Where a clip's LiDAR sits: no data set's points say it once they are in the world, but they can tell.

A sensor looks in the same directions of its rig in each turn. Points of several sweeps, seen from where it sits, lie in
the same narrow rows of directions; seen from elsewhere, each is off by its own angle, and the rows blur.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numba
import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.datasets.clip import Sweep
from instdrive_core.sweeps.pattern import AMID, trace_pattern
from instdrive_core.sweeps.rig import Rig

USUAL_PLACE = AMID + np.array([0.0, 0.0, 0.4])
"""Where a sensor is taken to be that tells nothing: on the roof, a little above the cameras."""
_SWEEPS, _MOST_POINTS = 4, 25_000
_AHEAD, _LEFT, _UP = np.arange(-1.5, 1.51, 0.3), np.array([-0.3, 0.0, 0.3]), np.arange(-0.1, 1.01, 0.1)
"""Metres from amid the cameras at which the search begins: LiDARs sit on the roof, cameras on or below it."""
_ROUNDS = ((0.15, 0.4, 10.0), (0.08, 0.25, 8.0), (0.04, 0.15, 6.0), (0.02, 0.1, 5.0), (0.01, 0.07, 4.0))
"""Step of the search (metres), width of the rows (degrees), and from how far away points count (metres)."""
_STARTS, _REPEATS = 3, 3
_SECTORS = 36
_LOWEST, _HIGHEST = -30.0, 30.0
"""Degrees between which rows are looked at."""
_SMOOTH = 1.5
"""Degrees over which the rows' mean is taken off: what is left is how they alternate."""


def find_sensor_place(rig: Rig, sweeps: Sequence[Sweep]) -> Float64[ndarray, "3"]:
    """Find the place in the rig (metres) from which the sweeps look in the same directions; needs two sweeps.

    Args:
        rig: the clip's, in the world of the sweeps.
        sweeps: of the clip; a few of them, evenly over the drive, are read.
    """
    rows = np.unique(np.linspace(0, len(sweeps) - 1, _SWEEPS).round().astype(int)) if sweeps else []
    clouds = [_place_in_rig(rig, sweeps[int(row)]) for row in rows]
    clouds = [cloud for cloud in clouds if len(cloud)]
    if len(clouds) < 2:
        return USUAL_PLACE
    tried = {tuple(place): np.array(place) for place in itertools.product(_AHEAD, _LEFT, _UP)}
    best = [USUAL_PLACE]
    for number, (step, width, nearest) in enumerate(_ROUNDS):
        for _ in range(_REPEATS if number >= len(_ROUNDS) - 2 else 1):
            places = list(tried.values()) if not number else _list_around(best, step)
            scores = [_measure_likeness(clouds, place, width, nearest) for place in places]
            before, best = best[0], [places[row] for row in np.argsort(scores)[::-1][:_STARTS]]
            if np.allclose(best[0], before):
                break
    return best[0]


def _place_in_rig(rig: Rig, sweep: Sweep) -> Float64[ndarray, "n 3"]:
    """Points of a sweep from amid the cameras, as the rig was when each was measured."""
    pattern = trace_pattern(rig, sweep.time, sweep.load())
    reach = np.zeros(len(pattern.directions)) if pattern.ranges is None else pattern.ranges
    some = slice(None, None, len(reach) // _MOST_POINTS | 1)  # odd: beams are many, and their number is even
    return pattern.directions[some].astype(np.float64) * reach[some, None]


def _list_around(places: Sequence[Float64[ndarray, "3"]], step: float) -> list[Float64[ndarray, "3"]]:
    """Places one step around others; half a step upwards, as rows tell heights best."""
    moves = [step * np.array([x, y, z / 2]) for x, y, z in itertools.product((0, -1, 1), repeat=3)]
    found = {tuple(np.round(place + move, 4)): place + move for place in places for move in moves}
    return list(found.values())


def _measure_likeness(
    clouds: Sequence[Float64[ndarray, "n 3"]], place: Float64[ndarray, "3"], width: float, nearest: float
) -> float:
    """Mean correlation between sweeps of how many points lie in each row of directions, by sector."""
    count = int((_HIGHEST - _LOWEST) / width)
    window = int(_SMOOTH / width) | 1
    rows = [_alternate(_count_rows(cloud, place, nearest, count), window) for cloud in clouds]
    norms = [max(float(np.linalg.norm(each)), 1e-12) for each in rows]
    pairs = list(itertools.combinations(range(len(rows)), 2))
    return float(np.mean([(rows[a] * rows[b]).sum() / (norms[a] * norms[b]) for a, b in pairs]))


@numba.njit(cache=True, error_model="numpy")
def _count_rows(
    points: Float64[ndarray, "n 3"], place: Float64[ndarray, "3"], nearest: float, count: int
) -> Float64[ndarray, "s c"]:
    """Points by sector and row of directions, as seen from a place."""
    counts = np.zeros((_SECTORS, count))
    for i in range(len(points)):
        x, y, z = points[i, 0] - place[0], points[i, 1] - place[1], points[i, 2] - place[2]
        across = np.sqrt(x * x + y * y)
        if x * x + y * y + z * z <= nearest * nearest:
            continue
        row = int(np.floor((np.degrees(np.arctan2(z, across)) - _LOWEST) / (_HIGHEST - _LOWEST) * count))
        if 0 <= row < count:
            sector = int((np.arctan2(y, x) + np.pi) / (2 * np.pi) * _SECTORS)
            counts[min(sector, _SECTORS - 1), row] += 1
    return counts


def _alternate(counts: Float64[ndarray, "s c"], window: int) -> Float64[ndarray, "s c"]:
    """Counts less their mean over a window of rows."""
    total = np.cumsum(np.pad(counts, ((0, 0), (window // 2 + 1, window // 2))), axis=1)
    return counts - (total[:, window:] - total[:, :-window]) / window
