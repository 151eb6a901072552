"""The smoothest depths that costs allow: semi-global matching (Hirschmüller 2008) over planes."""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float32, UInt8
from numpy import ndarray

_STEP, _JUMP = 10, 90
"""Costs of a neighbour one plane off, and of one anywhere else where the photo is even."""
_EDGE = 12.0
"""Grey values between neighbours that halve the cost of a jump: depths jump where colours do."""
_PATHS = ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, -1), (1, -1), (-1, 1))


def match_planes(costs: UInt8[ndarray, "h w d"], grey: Float32[ndarray, "h w"]) -> Float32[ndarray, "h w"]:
    """Choose each pixel's plane, as a number from 0 to d - 1 with a fraction between planes.

    Args:
        costs: of each pixel at each plane.
        grey: of the photo, 0 to 255.
    """
    total = np.zeros(costs.shape, np.uint16)
    for down, right in _PATHS:
        _add_path(costs, grey, down, right, total)
    return _take_best(total)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _add_path(
    costs: UInt8[ndarray, "h w d"], grey: Float32[ndarray, "h w"], down: int, right: int, total: ndarray
) -> None:
    """Add the costs of the cheapest ways that come to each pixel in one direction."""
    height, width, planes = costs.shape
    before, now = np.zeros((width, planes), np.uint16), np.zeros((width, planes), np.uint16)
    for position in range(height):
        row = position if down >= 0 and (down or right > 0) else height - 1 - position
        for place in range(width):
            column = place if right > 0 or (right == 0 and down > 0) else width - 1 - place
            source = column - right
            comes = 0 <= source < width and 0 <= row - down < height
            if not comes:
                for plane in range(planes):
                    now[column, plane] = costs[row, column, plane]
            else:
                previous = now[source] if down == 0 else before[source]
                step = abs(grey[row, column] - grey[row - down, source])
                jump = max(np.int32(_JUMP / (1 + step / _EDGE)), _STEP + 1)
                least = previous.min()
                for plane in range(planes):
                    cheapest = min(np.int32(previous[plane]), np.int32(least) + jump)
                    if plane:
                        cheapest = min(cheapest, np.int32(previous[plane - 1]) + _STEP)
                    if plane + 1 < planes:
                        cheapest = min(cheapest, np.int32(previous[plane + 1]) + _STEP)
                    now[column, plane] = costs[row, column, plane] + cheapest - np.int32(least)
            for plane in range(planes):
                total[row, column, plane] += now[column, plane]
        before, now = now, before


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _take_best(total: ndarray) -> Float32[ndarray, "h w"]:
    """The cheapest plane of each pixel, with the fraction at which the parabola through its neighbours is lowest."""
    height, width, planes = total.shape
    chosen = np.empty((height, width), np.float32)
    for row in range(height):
        for column in range(width):
            best = 0
            for plane in range(1, planes):
                if total[row, column, plane] < total[row, column, best]:
                    best = plane
            offset = 0.0
            if 0 < best < planes - 1:
                left, here, right = (
                    np.float64(total[row, column, best - 1]),
                    np.float64(total[row, column, best]),
                    np.float64(total[row, column, best + 1]),
                )
                bend = left - 2 * here + right
                if bend > 0:
                    offset = 0.5 * (left - right) / bend
            chosen[row, column] = best + offset
    return chosen
