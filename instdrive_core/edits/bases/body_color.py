"""The body colour of an object, and what of it has that colour: not its glass, tyres, lights or shadow."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Float32, Int64
from numpy import ndarray

from instdrive_core.edits.bases.adjustments import LUMA
from instdrive_core.maths.spherical_harmonics import color_from_dc
from instdrive_core.scene.gaussians import Gaussians

RGB = tuple[float, float, float]
SHADE = 0.25
"""How much a change of brightness by the factor e counts, where a full change of chromaticity counts 1."""
FLOOR = 0.05
"""Brightness that is added to all: the hue of what is black says little."""
CELL = 0.12
"""Side of the cells of look in which the most common one is searched."""
REFINEMENTS = 4
WIDEST = 0.18
"""Radius in look around the most common one whose mean the body colour is."""


def find_body_color(gaussians: Gaussians, rows: Int64[ndarray, " m"]) -> RGB:
    """Find the colour (RGB, 0 … 1, without view dependence) that most of the surface of some rows (at least one) has.

    Rows count by opacity and size. Light and shade of one paint count as one colour.
    """
    colors = _read_colors(gaussians, rows)
    looks = _compute_looks(colors)
    sizes = np.sort(np.exp(gaussians.log_scales[rows].astype(np.float64)), axis=1)
    weights = gaussians.opacities[rows] * np.minimum(
        sizes[:, 1] * sizes[:, 2], np.median(sizes[:, 1] * sizes[:, 2]) * 4
    )
    weights = weights + 1e-12
    cells = np.floor(looks / CELL).astype(np.int64)
    first = cells.min(axis=0)
    shape = cells.max(axis=0) - first + 1  # some hundred cells at most: looks are bounded
    keys, cell = np.unique(np.ravel_multi_index(tuple((cells - first).T), shape), return_inverse=True)
    unique = np.stack(np.unravel_index(keys, shape), axis=1) + first
    totals = np.bincount(cell, weights)
    near = np.abs(unique[:, None] - unique[None]).max(axis=-1) <= 1
    center = (unique[int(np.argmax(near @ totals))] + 0.5) * CELL
    kept = np.ones(len(rows), bool)
    for _ in range(REFINEMENTS):
        around = np.linalg.norm(looks - center, axis=1) <= WIDEST
        if not around.any():
            break
        kept = around
        center = np.average(looks[kept], axis=0, weights=weights[kept])
    red, green, blue = np.average(colors[kept], axis=0, weights=weights[kept]).tolist()
    return red, green, blue


def find_rows_near_color(
    gaussians: Gaussians, rows: Int64[ndarray, " m"], reference: RGB, tolerance: float
) -> Bool[ndarray, " m"]:
    """Find which rows look like `reference` (RGB, 0 … 1) up to a difference of 0 (only the same) to 1 (anything)."""
    differences = _compute_looks(_read_colors(gaussians, rows)) - _compute_looks(np.array([reference]))
    return np.linalg.norm(differences, axis=1) <= tolerance if tolerance < 1 else np.ones(len(rows), bool)


def _read_colors(gaussians: Gaussians, rows: Int64[ndarray, " m"]) -> Float32[ndarray, "m 3"]:
    return np.clip(color_from_dc(gaussians.sh_dc[rows]), 0, 1).astype(np.float32)


def _compute_looks(colors: Float[ndarray, "m 3"]) -> Float[ndarray, "m 3"]:
    """Red and green chromaticity, and the logarithm of the brightness times `SHADE`."""
    floored = colors + FLOOR
    chromaticity = floored[:, :2] / floored.sum(axis=1, keepdims=True)
    return np.c_[chromaticity, SHADE * np.log(floored @ LUMA)]
