"""The sun whose shadows agree best with which ground of a street is dark.

One direction for the whole stretch and one height for each piece of its houses: what photos show of things and fronts
throws shadows, and houses may be higher than what photos show of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray
from scipy import ndimage

from instdrive_core.edits.holes.sunlight.house_heights import add_ground, infer_heights, weigh_seen_tops
from instdrive_core.edits.holes.sunlight.standing_rows import HEIGHTS, LEVEL, StandingRows

TEMPER = 0.35
"""Share of what each cell tells that counts: neighbours tell the same."""
SHADOW_GAP = 0.4
"""Metres: gaps of the shadow of one thing that are closed."""
FARTHEST_FRONT = 25.0
"""Metres from which a house throws its shade at most."""
DEPTH = 10.0
"""Metres that houses reach behind their fronts: above a low house a ray may still meet the side of the next."""
TALLER = 1.5
"""Metres by which such a neighbour is taller."""
AZIMUTHS, ELEVATIONS = np.arange(0, 360, 12), (22.0, 32.0, 42.0, 52.0, 62.0)
"""Degrees that are tried first."""
THINNED = 3
"""Every so-many-th cell of the ground is looked at for these."""
STEEPNESS = (12.0, 80.0)
"""Degrees: the lowest and the highest sun."""
FINER = (5.0, 2.5)
"""Degrees between the directions around the best that are tried then."""
SURE_SHADOW = 0.97
"""Probability that ground is dark where something that photos show keeps the sun away."""
RIM_SHADOW = 0.4
"""Probability at the rim of that shadow, which points make broader than it is."""
_STEPS = 16


@dataclass(frozen=True)
class GroundLights:
    """Ground of which photos show whether it is dark."""

    places: Float64[ndarray, "k 2"]
    """Metres along and across from the corner of the grid of what stands."""
    heights: Float64[ndarray, " k"]
    """Metres."""
    told: Float64[ndarray, " k"]
    """Logarithm of how much likelier it looks in the shade than in the sun."""


@dataclass(frozen=True)
class Sun:
    """A direction, and how high houses are if the sun stands there."""

    toward: tuple[float, float]
    """Unit vector along and across towards the sun."""
    slope: float
    """Metres that it rises for each of these."""
    heights: Float64[ndarray, "p h"]
    """Probability of each of `HEIGHTS` at each place of one side of the street, then of the other."""
    evidence: float
    """Logarithm of how likely the ground is, up to a constant."""


def find_sun(rows: StandingRows, ground: GroundLights) -> Sun:
    """The likeliest sun."""
    seen = [weigh_seen_tops(tops, framed) for tops, framed in zip(rows.tops, rows.framed, strict=True)]
    part = GroundLights(ground.places[::THINNED], ground.heights[::THINNED], THINNED * ground.told[::THINNED])
    first = [(float(azimuth), elevation) for azimuth in AZIMUTHS for elevation in ELEVATIONS]
    best = max(first, key=lambda one: fit_heights(rows, part, *one, seen, rounds=1).evidence)
    tried: dict[tuple[float, float], Sun] = {}
    for step in FINER:
        for turn in (-2, -1, 0, 1, 2):
            for lift in (-1, 0, 1):
                key = ((best[0] + turn * step) % 360, float(np.clip(best[1] + lift * step, *STEEPNESS)))
                if key not in tried:
                    tried[key] = fit_heights(rows, ground, *key, seen)
        best = max(tried, key=lambda key: tried[key].evidence)
    return tried[best]


def fit_heights(
    rows: StandingRows,
    ground: GroundLights,
    azimuth: float,
    elevation: float,
    seen: list[Float64[ndarray, "a h"]],
    rounds: int = 2,
) -> Sun:
    """How high houses are if the sun stands at that azimuth (degrees from along towards across) and elevation;
    `seen` are the logarithms of what photos tell of either side's heights."""
    turn, slope = np.radians(azimuth), float(np.tan(np.radians(elevation)))
    sun = Sun((float(np.cos(turn)), float(np.sin(turn))), slope, np.zeros((0, len(HEIGHTS))), 0.0)
    shadows = throw_shadows(rows, sun)
    dark = _look_up(np.asarray(ndimage.binary_erosion(shadows), bool), ground.places, rows.grid.size)
    places, needed = _follow_rays(rows, sun, ground.places, ground.heights)
    first, count = places[:, 0], rows.grid.shape[0]
    counts = ~_look_up(shadows, ground.places, rows.grid.size) & (first >= 0)
    told = TEMPER * ground.told
    behind = np.zeros(len(first))
    for number in range(rounds):
        # A taller neighbour may darken ground, too: then this house need not.
        mixed = np.log(behind * np.exp(told) + 1 - behind)
        parts = []
        for side in (0, 1):
            mine = counts & (first // count == side)
            logs = seen[side] + add_ground(first[mine] - side * count, needed[mine, 0], (told - mixed)[mine], count)
            parts.append(infer_heights(logs))
        evidence = float(sum(part[1] for part in parts) + mixed[counts].sum() + told[dark].sum())
        sun = Sun(sun.toward, slope, np.concatenate([part[0] for part in parts]), evidence)
        if number == rounds - 1:
            break
        means = sun.heights @ HEIGHTS
        taller = (places >= 0) & (means[places] > means[np.maximum(first, 0)][:, None] + TALLER)
        behind = np.minimum(np.where(taller, _reach(sun, places, needed), 0).max(axis=1), SURE_SHADOW)
    return sun


def forecast_shade(
    rows: StandingRows,
    sun: Sun,
    places: Float64[ndarray, "k 2"],
    heights: Float64[ndarray, " k"],
    standing: Bool[ndarray, " n"] | None = None,
) -> Float64[ndarray, " k"]:
    """Probability that each place on the ground lies in the shade of what is still `standing` of the rows' points."""
    shadows = throw_shadows(rows, sun, standing)
    inside = _look_up(np.asarray(ndimage.binary_erosion(shadows), bool), places, rows.grid.size)
    rim = _look_up(shadows, places, rows.grid.size)
    houses = _reach(sun, *_follow_rays(rows, sun, places, heights)).max(axis=1)
    return np.maximum(houses, np.where(inside, SURE_SHADOW, np.where(rim, RIM_SHADOW, 0)))


def throw_shadows(rows: StandingRows, sun: Sun, standing: Bool[ndarray, " n"] | None = None) -> Bool[ndarray, "a b"]:
    """Cells in the shadow of the points, and those between them."""
    size = rows.grid.size
    counts = np.ones(len(rows.places), bool) if standing is None else standing
    gap = max(1, round(SHADOW_GAP / 2 / size))
    padded = np.pad(np.zeros(rows.grid.shape, bool), gap)
    shift = (sun.toward[0] / sun.slope, sun.toward[1] / sun.slope)
    _throw(rows.places, rows.heights, counts, shift, size, padded[gap:-gap, gap:-gap])
    return np.asarray(ndimage.binary_closing(padded, np.ones((3, 3)), iterations=gap), bool)[gap:-gap, gap:-gap]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _throw(
    places: Float64[ndarray, "n 2"],
    heights: Float64[ndarray, " n"],
    counts: Bool[ndarray, " n"],
    shift: tuple[float, float],
    size: float,
    cells: Bool[ndarray, "a b"],
) -> None:
    """Mark the cells that those points which count throw their shadow on, `shift` metres for each of height."""
    for k in range(len(places)):
        if counts[k]:
            a = int(np.floor((places[k, 0] - heights[k] * shift[0]) / size))
            b = int(np.floor((places[k, 1] - heights[k] * shift[1]) / size))
            if 0 <= a < cells.shape[0] and 0 <= b < cells.shape[1]:
                cells[a, b] = True


def _look_up(cells: Bool[ndarray, "a b"], places: Float64[ndarray, "k 2"], size: float) -> Bool[ndarray, " k"]:
    found = np.floor(places / size).astype(np.int64)
    inside: Bool[ndarray, " k"] = np.asarray(((found >= 0) & (found < cells.shape)).all(axis=1), bool)
    return cells[tuple(np.where(inside[:, None], found, 0).T)] & inside


def _follow_rays(
    rows: StandingRows, sun: Sun, places: Float64[ndarray, "k 2"], heights: Float64[ndarray, " k"]
) -> tuple[Int64[ndarray, "k s"], Float64[ndarray, "k s"]]:
    """The places of the rows that rays from the ground to the sun pass, the front first, and how high these rays are
    there; -1 where they pass none."""
    found, away = _walk(
        np.ascontiguousarray(places), rows.walls, rows.fronts, sun.toward, rows.grid.size, FARTHEST_FRONT, DEPTH
    )
    return found, away * sun.slope + heights[:, None]


def _reach(sun: Sun, places: Int64[ndarray, "k s"], needed: Float64[ndarray, "k s"]) -> Float64[ndarray, "k s"]:
    """Probability that the houses are at least that high."""
    higher = np.c_[np.cumsum(sun.heights[:, ::-1], axis=1)[:, ::-1], np.zeros(len(sun.heights))]
    levels = np.clip(np.ceil(needed / LEVEL - 0.5), 0, len(HEIGHTS)).astype(np.int64)
    return higher[np.maximum(places, 0), levels] * (places >= 0)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _walk(
    places: Float64[ndarray, "k 2"],
    walls: Bool[ndarray, "a b"],
    fronts: Int64[ndarray, "2 a"],
    toward: tuple[float, float],
    size: float,
    farthest: float,
    depth: float,
) -> tuple[Int64[ndarray, "k s"], Float64[ndarray, "k s"]]:
    """Walk from each place until a wall stands there, and on through the row behind its front."""
    found = np.full((len(places), _STEPS), -1, np.int64)
    away = np.zeros((len(places), _STEPS))
    along, across = walls.shape
    half, step, pace = across // 2, size / 2, depth / _STEPS
    for k in range(len(places)):
        number, met = 0, 0.0
        for i in range(1, int((farthest + depth) / step)):
            distance = i * step
            a = int(np.floor((places[k, 0] + toward[0] * distance) / size))
            b = int(np.floor((places[k, 1] + toward[1] * distance) / size))
            if a < 0 or a >= along:
                break
            side = 0 if b < half else 1
            if number == 0:
                if b < 0 or b >= across or distance > farthest:
                    break
                if walls[a, b]:
                    found[k, 0], away[k, 0], met, number = a + side * along, distance, distance, 1
            elif distance - met >= pace * number:
                if (side == 0 and b <= fronts[0, a]) or (side == 1 and b >= fronts[1, a]):
                    found[k, number], away[k, number] = a + side * along, distance
                number += 1
                if number == _STEPS:
                    break
    return found, away
