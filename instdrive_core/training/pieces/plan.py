"""Where a long drive is cut: pieces of road, each with the time steps that it is trained on. Pure arithmetic."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import ceil

import numpy as np
from jaxtyping import Float64, Int64
from numpy import ndarray

from instdrive_core.errors import OptionError

USUAL_STEPS = 100
"""Time steps that are one piece however fast the car drives: the paper's unit has 80."""
MOST_METRES = 150.0
"""Metres of road that one scene has enough Gaussians for (`settings.clip_size` grows it no further)."""
MOST_PHOTOS = 648
"""Training photos that one run is long enough for (`settings.clip_size` stretches it no further)."""
PIECE_METRES, PIECE_PHOTOS = 60.0, 432
"""Size of a piece without its overlaps: the second is the paper's unit of 72 training steps of six cameras."""
LEAST_METRES = 20.0
"""Metres of road below which `auto` cuts no further, as before a red light: the places would be the same."""
OVERLAP = 1 / 6
"""Share of a piece's way that each of its neighbours is trained on as well."""
LEAST_STEPS = 2
"""Time steps of a piece without its overlaps."""
_MOVING = 0.3
"""Share of the middle speed below which the car hardly moves; no border lies there."""


@dataclass(frozen=True)
class DriveStep:
    """What the plan must know of a time step."""

    index: int
    place: Float64[ndarray, "3"]
    """Middle of its cameras, metres."""
    photos: int
    """Training photos."""


@dataclass(frozen=True)
class Piece:
    """A stretch of the drive. All time steps are inclusive."""

    first: int
    """First time step that it is trained on."""
    last: int
    core_first: int
    """First time step that belongs to this piece alone: the cores of all pieces are the drive."""
    core_last: int
    metres: float
    """Way of the steps that it is trained on."""


@dataclass(frozen=True)
class DriveSize:
    """How much of everything a drive has."""

    steps: int
    photos: int
    metres: float


def measure_drive(steps: Sequence[DriveStep]) -> DriveSize:
    """Measure a drive; `steps` are in order."""
    return DriveSize(len(steps), sum(step.photos for step in steps), float(_list_ways(steps).sum()))


def count_pieces(size: DriveSize, affordable_photos: int = MOST_PHOTOS) -> int:
    """Count the pieces that a drive needs; 1 for those that one run is made for.

    `affordable_photos` are the training photos that memory suffices for.
    """
    is_short = size.metres <= MOST_METRES or size.steps <= USUAL_STEPS
    if is_short and size.photos <= min(MOST_PHOTOS, affordable_photos):
        return 1
    by_way, by_photos = size.metres / PIECE_METRES, size.photos / max(1, min(PIECE_PHOTOS, affordable_photos))
    most = max(1, int(size.metres // LEAST_METRES))
    return min(max(ceil(by_way) if not is_short else 1, ceil(by_photos)), most, max(1, size.steps // LEAST_STEPS))


def plan_pieces(steps: Sequence[DriveStep], count: int) -> tuple[Piece, ...]:
    """Cut a drive into `count` pieces of like way and number of photos, in the order of the drive.

    Neighbours overlap by a share of their way, and by one time step at least. Borders lie where the car moves.

    Raises OptionError where there are too few time steps.
    """
    most = len(steps) // LEAST_STEPS
    if not 1 <= count <= max(1, most):
        raise OptionError(f"--pieces is {count}; {len(steps)} time steps can be cut into 1 to {max(1, most)}")
    ways, photos = _list_ways(steps), np.array([step.photos for step in steps], np.float64)
    starts = [0, *_choose_borders(ways, photos, count), len(steps)]
    travelled, reach = np.cumsum(ways), OVERLAP * ways.sum() / count
    pieces = []
    for start, end in pairwise(starts):
        first = last = 0
        if start:  # at most half of the neighbour
            before = starts[starts.index(start) - 1]
            near = int(np.searchsorted(travelled, travelled[start] - reach))
            first = min(max(near, (before + start) // 2), start - 1)
        last = len(steps) - 1
        if end < len(steps):
            after = starts[starts.index(end) + 1]
            near = int(np.searchsorted(travelled, travelled[end - 1] + reach, side="right")) - 1
            last = max(min(near, (end + after - 1) // 2), end)
        way = float(travelled[last] - travelled[first])
        pieces.append(
            Piece(steps[first].index, steps[last].index, steps[start].index, steps[end - 1].index, round(way, 1))
        )
    return tuple(pieces)


def describe_pieces(metres: float | None, pieces: Sequence[Piece]) -> str:
    """Say how a drive is cut; without metres where the clip's unit is not known."""
    if metres is None:
        return f"{len(pieces)} pieces along the drive"
    mean = np.mean([piece.metres for piece in pieces])
    return f"drive of {metres:.0f} m: {len(pieces)} pieces of ~{round(float(mean), -1):.0f} m"


def _list_ways(steps: Sequence[DriveStep]) -> Float64[ndarray, " s"]:
    """Metres from the step before to each; the first is 0."""
    places = np.array([step.place for step in steps]).reshape(-1, 3)
    return np.concatenate([np.zeros(min(1, len(steps))), np.linalg.norm(np.diff(places, axis=0), axis=1)])


def _choose_borders(ways: Float64[ndarray, " s"], photos: Float64[ndarray, " s"], count: int) -> list[int]:
    """First places of all cores but the first: equal shares of way and photos, moved to where the car moves."""
    load = ways / max(ways.sum(), 1e-9) + photos / max(photos.sum(), 1e-9)
    done = np.cumsum(load) / max(load.sum(), 1e-9)
    moving = ways >= _MOVING * np.median(ways[ways > 0]) if (ways > 0).any() else np.ones(len(ways), bool)
    borders: list[int] = []
    for number in range(1, count):
        low = (borders[-1] if borders else 0) + LEAST_STEPS
        high = len(ways) - (count - number) * LEAST_STEPS
        places: Int64[ndarray, " p"] = np.arange(low, high + 1)
        usable = places[moving[places]] if moving[places].any() else places
        borders.append(int(usable[np.argmin(np.abs(done[usable - 1] - number / count))]))
    return borders
