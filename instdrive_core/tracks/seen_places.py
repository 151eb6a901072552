"""What a sweep says of places: it met something there, saw through them, or could not see them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64, UInt8
from numba import njit
from numpy import ndarray

from instdrive_core.tracks.range_images import HIGHEST, LOWEST, NOTHING, SweepImage

UNSEEN, MET, SEEN_THROUGH = 0, 1, 2
"""Answers: hidden by something nearer or looked at by no beam; something is there; beams go on behind it."""
SAME, SAME_SHARE = 0.25, 0.01
"""Metres, and share of its distance, within which a beam ends at a place."""


def ask_sweep(places: Float64[ndarray, "n 3"], image: SweepImage) -> UInt8[ndarray, " n"]:
    """What one LiDAR's sweep says of places in the world (metres): `UNSEEN`, `MET` or `SEEN_THROUGH`.

    A place is met if one of the nine pixels around its direction ends there. It is seen through if none does, its own
    pixel is measured and goes on, and so do two to either side: where beams are sparse, every other column may be
    empty, and along a wall seen aslant one column goes on a metre farther than the next. Rows above and below are not
    asked: of cars in a queue one sees strips, a row or two high, over the roofs of others.
    """
    return _look(np.ascontiguousarray(places, np.float64), image.position, image.ranges)


@njit(cache=True)
def _look(places: ndarray, position: ndarray, ranges: ndarray) -> ndarray:
    rows, columns = ranges.shape
    answers = np.full(len(places), UNSEEN, np.uint8)
    for number in range(len(places)):
        x = places[number, 0] - position[0]
        y = places[number, 1] - position[1]
        z = places[number, 2] - position[2]
        flat = np.sqrt(x * x + y * y)
        distance = np.sqrt(flat * flat + z * z)
        row = int(np.floor((np.degrees(np.arctan2(z, flat)) - LOWEST) * rows / (HIGHEST - LOWEST)))
        if row < 1 or row >= rows - 1:
            continue
        column = int((np.arctan2(y, x) / (2 * np.pi) + 0.5) * columns) % columns
        slack = SAME + SAME_SHARE * distance
        met, least = False, 1e9
        for above in range(row - 1, row + 2):
            for side in range(-2, 3):
                pixel = ranges[above, (column + side) % columns]
                if pixel != NOTHING:
                    met |= abs(side) < 2 and abs(pixel * 0.01 - distance) < slack
                    if above == row:
                        least = min(least, pixel * 0.01)
        if met:
            answers[number] = MET
        elif ranges[row, column] != NOTHING and least > distance + slack:
            answers[number] = SEEN_THROUGH
    return answers
