"""Which pictures of a video become photos of a clip: the sharpest ones, far enough apart to see depth."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from instdrive_core.datasets.capture.candidates import Candidate
from instdrive_core.errors import OptionError

PARALLAX = 0.015
"""Share of the picture's width that the scene moves from one photo to the next: less tells nothing of depth, and much
more leaves too little to match."""
FEWEST = 8
"""Photos with which structure from motion has a fair chance."""


def choose_pictures(candidates: Sequence[Candidate], most: int) -> list[int]:
    """Choose the numbers of pictures, in order.

    The way of the scene over the picture is cut into equal stretches of `PARALLAX`, longer ones where there would be
    more than `most`. Of each the sharpest picture is taken: a stop yields one photo, and blurred ones are left out.

    Raises OptionError where `most` is below `FEWEST`.
    """
    if most < FEWEST:
        raise OptionError(f"--most is {most}; give at least {FEWEST} photos")
    if not candidates:
        return []
    way = np.cumsum([0.0, *(min(candidate.shift, 0.5) for candidate in candidates[1:])])
    stretch = max(PARALLAX, float(way[-1]) / max(most - 1, 1) * 1.0001)
    best: dict[int, Candidate] = {}
    for candidate, place in zip(candidates, way, strict=True):
        number = math.floor(place / stretch + 1e-9)
        if number not in best or candidate.sharpness > best[number].sharpness:
            best[number] = candidate
    return [candidate.number for _, candidate in sorted(best.items())]
