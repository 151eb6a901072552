"""Which depths other photos confirm."""

from __future__ import annotations

from collections.abc import Sequence

import numba
import numpy as np
from jaxtyping import Float32, Float64, UInt8
from numpy import ndarray

from instdrive_core.scene.camera import Camera
from instdrive_core.stereo.pixel_relation import carry_over, relate_pixels

_TOLERANCE = 1.0
"""Pixels by which a point may miss its own, when it goes to the partner and comes back with the partner's depth."""
_DEPTH_TOLERANCE = 0.05
"""Difference of two photos' depths of one point, as a share of it."""


def count_agreeing(
    inverse: Float32[ndarray, "h w"], camera: Camera, partners: Sequence[tuple[Float32[ndarray, "..."], Camera]]
) -> UInt8[ndarray, "h w"]:
    """Count for each pixel the partners that see the same point at its place.

    Args:
        inverse: inverse depths of the photo, 1 / metres; 0 = infinitely far or unknown, which nobody confirms.
        camera: of the photo.
        partners: inverse depths and cameras of other photos.
    """
    counts = np.zeros(inverse.shape, np.uint8)
    for other, partner in partners:
        _count(inverse, other, *relate_pixels(camera, partner), *relate_pixels(partner, camera), counts)
    return counts


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _count(
    inverse: Float32[ndarray, "h w"],
    other: Float32[ndarray, "h2 w2"],
    turn: Float64[ndarray, "3 3"],
    shift: Float64[ndarray, "3"],
    turn_back: Float64[ndarray, "3 3"],
    shift_back: Float64[ndarray, "3"],
    counts: UInt8[ndarray, "h w"],
) -> None:
    for row in range(inverse.shape[0]):
        for column in range(inverse.shape[1]):
            near = np.float64(inverse[row, column])
            if near <= 0:
                continue
            u, v = column + 0.5, row + 0.5
            x, y, z = carry_over(turn, shift, u, v, near)
            if z <= 1e-6 or not (0 <= x < other.shape[1] and 0 <= y < other.shape[0]):
                continue
            theirs, expected = np.float64(other[int(y), int(x)]), near / z
            if theirs <= 0 or abs(theirs - expected) > _DEPTH_TOLERANCE * expected:
                continue
            x_back, y_back, _ = carry_over(turn_back, shift_back, x, y, theirs)
            if (x_back - u) ** 2 + (y_back - v) ** 2 <= _TOLERANCE**2:
                counts[row, column] += 1
