"""Nearest points by looking at all of them: clouds of some hundred points need no tree."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, Float64, Int64
from numba import njit
from numpy import ndarray

ALIGNMENTS = 10
"""Steps of closest points that settle a displacement."""


def sample_evenly(points: Float32[ndarray, "n 3"], limit: int) -> Float32[ndarray, "m 3"]:
    """At most `limit` of the points, evenly through them."""
    if len(points) <= limit:
        return np.ascontiguousarray(points, np.float32)
    return np.ascontiguousarray(points[(np.arange(limit) * len(points)) // limit], np.float32)


def sample_rows(rows: Int64[ndarray, " n"], limit: int) -> Int64[ndarray, " m"]:
    """At most `limit` of the rows, evenly through them."""
    count = min(limit, len(rows))
    return rows[(np.arange(count) * len(rows)) // max(count, 1)]


@njit(cache=True, fastmath=True)
def nearest_distances(first: ndarray, second: ndarray) -> ndarray:
    """Distance of each point of the first cloud from the nearest of the second, metres."""
    found = np.empty(len(first), np.float32)
    for i in range(len(first)):
        best = np.float32(1e12)
        for j in range(len(second)):
            x = first[i, 0] - second[j, 0]
            y = first[i, 1] - second[j, 1]
            z = first[i, 2] - second[j, 2]
            best = min(best, x * x + y * y + z * z)
        found[i] = np.sqrt(best)
    return found


@njit(cache=True, fastmath=True)
def _align(first: ndarray, second: ndarray, shift: ndarray, reach: float) -> ndarray:
    distances = np.empty(len(first), np.float32)
    steps = np.empty((len(first), 2), np.float32)
    for _ in range(ALIGNMENTS):
        for i in range(len(first)):
            best = np.float32(1e12)
            for j in range(len(second)):
                x = second[j, 0] - first[i, 0] - shift[0]
                y = second[j, 1] - first[i, 1] - shift[1]
                z = second[j, 2] - first[i, 2]
                square = x * x + y * y + z * z
                if square < best:
                    best = square
                    steps[i, 0], steps[i, 1] = x, y
            distances[i] = np.sqrt(best)
        limit = min(np.quantile(distances, 0.7), reach)
        x_sum, y_sum, count = 0.0, 0.0, 0
        for i in range(len(first)):
            if distances[i] <= limit:
                x_sum += steps[i, 0]
                y_sum += steps[i, 1]
                count += 1
        if count < 3:
            break
        shift[0] += x_sum / count
        shift[1] += y_sum / count
        if abs(x_sum) + abs(y_sum) < 0.005 * count:
            break
    return distances


def align(
    first: Float32[ndarray, "a 3"], second: Float32[ndarray, "b 3"], guess: Float64[ndarray, "2"], reach: float = 2.0
) -> tuple[Float64[ndarray, "2"], float]:
    """A displacement along the ground that brings the first cloud onto the second, refined from a guess, and the
    median distance (metres) of closest points that is left."""
    shift = np.array(guess, np.float64)
    distances = _align(first, second, shift, reach)
    return shift, float(np.median(distances))
