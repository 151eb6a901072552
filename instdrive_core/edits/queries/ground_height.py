"""Height of the ground below a place."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float32, Float64
from numpy import ndarray

RADII = (2.0, 4.0, 8.0)
"""Metres around the place within which ground is looked for, in this order."""
MIN_SPLATS, MAX_SPLATS = 20, 5000
"""Fewer within a radius are not enough; of more, evenly chosen ones say the same."""
LOWEST_SHARE, LEAST_LAYER = 0.1, 8
"""The ground is the lowest layer that holds this share of the splats, and so many: what trained below a road, where
nobody looks, is spread over metres …"""
BAND = 0.4
"""… and a layer is so many metres high."""
TOLERANCE = 0.1
"""Metres that ground may deviate from a plane."""
MAX_SLOPE = 0.5
_ROUNDS = 4


def estimate_ground_height(
    points: Float32[ndarray, "n 3"],
    place: Float[ndarray, "3"],
    radii: tuple[float, ...] = RADII,
) -> float | None:
    """Height (metres, z up) of the ground under `place`, among points that do not belong to what stands there.

    The ground is a plane through the lowest layer around; floaters may lie below it. None where there are too few
    points within the largest of `radii` (metres, rising).
    """
    offsets = points[:, :2] - np.asarray(place, np.float32)[:2]
    distances = np.einsum("ni,ni->n", offsets, offsets)
    for radius in radii:
        close = np.flatnonzero(distances < radius**2)
        if len(close) >= MIN_SPLATS:
            close = close[:: -(-len(close) // MAX_SPLATS)]
            return _fit_height_at_zero(offsets[close].astype(np.float64), points[close, 2].astype(np.float64))
    return None


def estimate_ground_heights(
    points: Float32[ndarray, "n 3"],
    places: Float[ndarray, "k 3"],
    radii: tuple[float, ...] = RADII,
) -> Float64[ndarray, " k"]:
    """Heights of the ground under many places, as `estimate_ground_height` finds each; NaN where there is none.

    Each place looks at the points near it along x only: of a street, that is a small part.
    """
    order = np.argsort(points[:, 0], kind="stable")
    along, heights = points[order, 0], np.full(len(places), np.nan)
    for radius in radii:
        first = np.searchsorted(along, (places[:, 0] - radius).astype(np.float32), "left")
        last = np.searchsorted(along, (places[:, 0] + radius).astype(np.float32), "right")
        for number in np.flatnonzero(np.isnan(heights) & (last - first >= MIN_SPLATS)).tolist():
            near = np.sort(order[first[number] : last[number]])
            height = estimate_ground_height(points[near], places[number], (radius,))
            heights[number] = np.nan if height is None else height
    return heights


def _find_lowest_layer(rising: Float64[ndarray, " k"]) -> float:
    """Lower edge of the lowest layer, or of the fullest where none is full enough."""
    counts = np.searchsorted(rising, rising + BAND, side="right") - np.arange(len(rising))
    full = counts >= max(LOWEST_SHARE * len(rising), LEAST_LAYER)
    return float(rising[np.argmax(full) if full.any() else np.argmax(counts)])


def _fit_height_at_zero(offsets: Float64[ndarray, "k 2"], heights: Float64[ndarray, " k"]) -> float:
    """Height at offset 0 of a plane that grows from the lowest points to all that agree with it."""
    low = _find_lowest_layer(np.sort(heights))
    kept = (heights >= low) & (heights <= low + BAND)
    level = float(np.median(heights[kept]))
    columns = np.c_[np.ones(len(offsets)), offsets]
    plane = np.array([level, 0.0, 0.0])
    for _ in range(_ROUNDS):
        if kept.sum() < MIN_SPLATS // 2:
            return level
        plane = np.linalg.lstsq(columns[kept], heights[kept], rcond=None)[0]
        if np.hypot(plane[1], plane[2]) > MAX_SLOPE:
            return level
        kept = np.abs(heights - columns @ plane) <= TOLERANCE
    return float(plane[0])
