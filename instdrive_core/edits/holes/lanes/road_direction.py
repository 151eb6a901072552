"""Which way the lines of a road run: kerbs, lane marks and the edges of pavements say it more exactly than a drive.

Whoever drives keeps to no line, and two degrees are half a metre at the other end of a parked car.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray
from scipy import ndimage

from instdrive_core.edits.holes.ground_grid import GroundGrid
from instdrive_core.edits.holes.ground_map import find_ground_splats
from instdrive_core.edits.holes.surroundings import Neighborhood
from instdrive_core.edits.queries.placement import SOLID_OPACITY

MOST_TURN = 6.0
"""Degrees to either side that are looked at."""
TURN_STEP = 0.2
"""Degrees between two directions, …"""
TURN_SMOOTHING = 0.2
"""… and the standard deviation over which directions are averaged."""
LINE = 0.1
"""Metres across of a line, as narrow as most marks."""
LEAST_ON_LINE = 5
"""Values on both of two lines side by side that are compared."""
MOST_PLACES = 60_000
"""Places that are looked at: enough for lines, however many splats there are."""
LEAST_PEAK = 1.75
"""Times by which lines must differ more in the direction found than in most others: noise and shadows without any lines
make it 1.5."""


def find_road_direction(grid: GroundGrid, near: Neighborhood) -> tuple[float, float]:
    """Unit vector of the lines on the ground near the direction of a grid; that one where there are none."""
    rows = np.flatnonzero(find_ground_splats(grid, near) & (near.opacities >= SOLID_OPACITY))
    heights, brightness = grid.compute_heights(near.means[rows]), near.colors[rows].mean(axis=1)
    return turn_to_lines(grid.along, near.means[rows, :2], np.c_[heights, np.clip(brightness, 0, 1)])


def turn_to_lines(
    along: tuple[float, float], places: Float[ndarray, "n 2"], values: Float[ndarray, "n v"]
) -> tuple[float, float]:
    """Turn a unit vector by at most `MOST_TURN` so that the ground changes least along it; the same one where no
    direction stands out.

    Lines in the right direction differ most from those right beside them, and shadows lie across them.

    Args:
        places: x and y of ground, metres.
        values: how it is there, each column in a unit of its own.
    """
    if not len(places):
        return along
    every = 1 + len(places) // MOST_PLACES
    places, values = places[::every], values[::every]
    turns = np.arange(-MOST_TURN, MOST_TURN + TURN_STEP / 2, TURN_STEP)
    forward = np.array(along)
    left = np.array([-forward[1], forward[0]])
    across, ahead = places @ left, places @ forward
    steps = np.array(
        [_measure_steps(across * np.cos(turn) - ahead * np.sin(turn), values) for turn in np.radians(turns)]
    )
    smooth = np.asarray(ndimage.gaussian_filter1d(steps, TURN_SMOOTHING / TURN_STEP, axis=0, mode="nearest"))
    peaks = (smooth / np.maximum(np.median(smooth, axis=0), 1e-12)).mean(axis=1)
    best = int(peaks.argmax())
    if peaks[best] < LEAST_PEAK or best in (0, len(turns) - 1):
        return along
    angle = np.radians(turns[best])
    x, y = np.cos(angle) * forward + np.sin(angle) * left
    return float(x), float(y)


def _measure_steps(across: Float64[ndarray, " n"], values: Float[ndarray, "n v"]) -> Float64[ndarray, " v"]:
    """Mean squared difference of two lines side by side, weighted by how many values both hold."""
    lines = np.floor((across - across.min()) / LINE).astype(np.int64)
    counts = np.bincount(lines)
    weights = np.minimum(counts[1:], counts[:-1]) * (np.minimum(counts[1:], counts[:-1]) >= LEAST_ON_LINE)
    sums = np.stack([np.bincount(lines, column) for column in values.T], axis=1)
    squares = np.diff(sums / np.maximum(counts, 1)[:, None], axis=0) ** 2
    return weights @ squares / max(weights.sum(), 1)
