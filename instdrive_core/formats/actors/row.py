"""A place for moving objects whose tracks are not known: side by side in a row above the world's origin."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from instdrive_core.scene.gaussians import Gaussians

_HEIGHT, _GAP, _WIDEST = 10.0, 1.0, 20.0
"""Metres above the origin, between neighbours, and that one of them gets at most."""


def lay_into_row(part: Gaussians, start: float, up: Float[ndarray, "3"]) -> float:
    """Move an object, in place, to the next place of a row along x above the world's origin.

    Args:
        part: its Gaussians.
        start: where the row has room, metres.
        up: the world's.

    Returns: where the row has room now, metres.
    """
    finite = part.means[np.isfinite(part.means).all(axis=1)].astype(np.float64)
    lower, upper = np.percentile(finite, [3, 97], axis=0) if len(finite) else (np.zeros(3), np.zeros(3))
    length = float(np.clip(upper[0] - lower[0], _GAP, _WIDEST))
    shift = np.array([start + length / 2, 0.0, 0.0]) + _HEIGHT * up - (lower + upper) / 2
    with np.errstate(over="ignore", invalid="ignore"):  # the linter reports what is not finite
        part.means += shift.astype(np.float32)
    return start + length + _GAP
