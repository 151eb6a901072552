"""How high something stands that is too wide for a single object."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64, Int64
from numpy import ndarray

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.queries.compact_objects import select_solid_points
from instdrive_core.instances.interiors import DEFAULT_CONFIG

HIGHEST = DEFAULT_CONFIG.max_length / 2
"""Metres from bottom to top up to which it is closed what something wide hid. Then nothing is continued farther than
behind the longest single object: what a house hid nobody can tell from what stands above and beside it."""
CELL = 1.0
"""Metres per side of the cells in the plane in which heights are measured."""
LEAST_IN_CELL, LEAST_SPLATS = 5, 20
"""Solid splats that a cell needs to be measured, and a thing."""
FOOT_HEIGHT = 2.0
"""Metres from the bottom up in which it is measured how wide something stands on the ground."""
FLAT = 0.12
"""Metres between the middle and the top of what is in most cells up to which something lies on the ground, or is the
ground: what trained below its surface, where nobody looks, is spread over metres."""
MAX_SLOPE = 0.2
"""Metres per metre by which the ground below may rise: more is the shape of the thing."""
_TRIM = 0.02


def measure_height(points: Float64[ndarray, "n 3"]) -> float:
    """Metres from bottom to top of what stands on the ground, be it on a slope; 0 of what lies on it.

    `points` (metres) are its solid splats; a few may be strays.
    """
    if len(points) < LEAST_SPLATS or _measure_usual_span(points) < FLAT:
        return 0.0
    offsets = points[:, :2] - points[:, :2].mean(axis=0)
    slope = np.linalg.lstsq(np.c_[np.ones(len(points)), offsets], points[:, 2], rcond=None)[0][1:]
    slope *= min(1.0, MAX_SLOPE / max(float(np.hypot(*slope)), 1e-9))
    return float(np.ptp(np.quantile(points[:, 2] - offsets @ slope, (_TRIM, 1 - _TRIM))))


def measure_standing_height(document: Document, rows: Int64[ndarray, " n"]) -> float:
    """Measure the height of what rows of the background make up, as `measure_height` does."""
    return measure_height(_select_standing(document, rows))


def hides_too_much(document: Document, rows: Int64[ndarray, " n"]) -> bool:
    """Whether a single object is higher than `HIGHEST` and stands on the ground over more than that, as a house does.

    What a crown hid goes on beside its trunk, where photos show it, and what a pole hid on both sides.
    """
    points = _select_standing(document, rows)
    if measure_height(points) <= HIGHEST:
        return False
    foot = points[points[:, 2] < np.quantile(points[:, 2], _TRIM) + FOOT_HEIGHT, :2]
    middle = foot - foot.mean(axis=0)
    longest = np.linalg.svd(middle, full_matrices=False)[2][0]
    return float(np.ptp(np.quantile(middle @ longest, (_TRIM, 1 - _TRIM)))) > HIGHEST


def _select_standing(document: Document, rows: Int64[ndarray, " n"]) -> Float64[ndarray, "k 3"]:
    return select_solid_points(document, rows[document.scene.nodes[rows] == 0])


def _measure_usual_span(points: Float64[ndarray, "n 3"]) -> float:
    """Metres between the middle and the top of what usually stands on a square metre."""
    cells = np.floor(points[:, :2] / CELL).astype(np.int64)
    _, places, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    heights = np.split(points[np.argsort(places.ravel(), kind="stable"), 2], np.cumsum(counts)[:-1])
    spans = [np.ptp(np.quantile(each, (0.5, 0.9))) for each in heights if len(each) >= LEAST_IN_CELL]
    return float(np.median(spans)) if spans else 0.0
