"""The body colour of objects, and what of them has that colour: not their glass, tyres, lights or shadow."""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray

from instdrive_core.edits.bases.adjustments import LUMA
from instdrive_core.edits.document.row_parts import RowParts
from instdrive_core.maths.spherical_harmonics import Y0
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
LARGEST = 4.0
"""Splats with a larger face than so many times the median of the object count as if they had this one."""
_CELLS = 12
"""Cells along each axis of look: chromaticity from 0 to 1, brightness from `FLOOR` to 1 + `FLOOR`, and one around."""
_FIRST = np.array([-1, -1, int(np.floor(SHADE * np.log(FLOOR) / CELL)) - 1])
_RED, _GREEN, _BLUE = (float(part) for part in LUMA)


def find_body_color(gaussians: Gaussians, rows: Int64[ndarray, " m"]) -> RGB:
    """Find the colour (RGB, 0 … 1, without view dependence) that most of the surface of some rows (at least one) has.

    Rows count by opacity and size. Light and shade of one paint count as one colour.
    """
    red, green, blue = find_body_colors(gaussians, RowParts.whole(rows))[0].tolist()
    return red, green, blue


def find_body_colors(gaussians: Gaussians, parts: RowParts) -> Float64[ndarray, "p 3"]:
    """Find the colour of each of some parts, none of which is empty; see `find_body_color`."""
    found = np.full((len(parts), 3), 0.5)  # what has no colour at all counts as grey
    _find_colors(
        parts.rows, parts.bounds, gaussians.sh_dc, gaussians.log_scales, gaussians.opacity_logits, _FIRST, found
    )
    return found


def find_rows_near_colors(
    gaussians: Gaussians, parts: RowParts, references: Float64[ndarray, "p 3"], tolerance: float
) -> Bool[ndarray, " m"]:
    """Find which rows look like the reference (RGB, 0 … 1) of their part, up to a difference of 0 (only the same) to 1
    (anything)."""
    near = np.ones(len(parts.rows), np.bool_)
    if tolerance < 1:
        _compare_looks(parts.rows, parts.bounds, gaussians.sh_dc, references, tolerance, near)
    return near


@numba.njit(inline="always")
def _read_color(sh_dc, row):
    """RGB of a row, from 0 to 1."""
    return (
        min(max(0.5 + Y0 * sh_dc[row, 0], 0.0), 1.0),
        min(max(0.5 + Y0 * sh_dc[row, 1], 0.0), 1.0),
        min(max(0.5 + Y0 * sh_dc[row, 2], 0.0), 1.0),
    )


@numba.njit(inline="always")
def _compute_look(red, green, blue):
    """Red and green chromaticity, and the logarithm of the brightness times `SHADE`."""
    r, g, b = red + FLOOR, green + FLOOR, blue + FLOOR
    return r / (r + g + b), g / (r + g + b), SHADE * np.log(_RED * r + _GREEN * g + _BLUE * b)


@numba.njit(parallel=True, cache=True, nogil=True, error_model="numpy")
def _compare_looks(rows, bounds, sh_dc, references, tolerance, near):
    for part in numba.prange(len(bounds) - 1):
        x, y, z = _compute_look(references[part, 0], references[part, 1], references[part, 2])
        for place in range(bounds[part], bounds[part + 1]):
            red, green, blue = _read_color(sh_dc, rows[place])
            u, v, w = _compute_look(red, green, blue)
            near[place] = (u - x) ** 2 + (v - y) ** 2 + (w - z) ** 2 <= tolerance**2


@numba.njit(inline="always")
def _find_commonest(totals, seen, first):
    """Middle of the cell that weighs most with those around it; only cells that were seen count."""
    best, x, y, z = -1.0, 0.0, 0.0, 0.0
    for i, j, m in np.argwhere(seen):
        around = totals[i - 1 : i + 2, j - 1 : j + 2, m - 1 : m + 2].sum()
        if around > best:
            best, x, y, z = around, i + first[0] + 0.5, j + first[1] + 0.5, m + first[2] + 0.5
    return x * CELL, y * CELL, z * CELL


@numba.njit(parallel=True, cache=True, nogil=True, error_model="numpy")
def _find_colors(rows, bounds, sh_dc, log_scales, opacity_logits, first, found):
    for part in numba.prange(len(bounds) - 1):
        count = bounds[part + 1] - bounds[part]
        colors, looks, faces = np.empty((count, 3)), np.empty((count, 3)), np.empty(count)
        for k in range(count):
            row = rows[bounds[part] + k]
            colors[k, 0], colors[k, 1], colors[k, 2] = _read_color(sh_dc, row)
            looks[k, 0], looks[k, 1], looks[k, 2] = _compute_look(colors[k, 0], colors[k, 1], colors[k, 2])
            a, b, c = np.float64(log_scales[row, 0]), np.float64(log_scales[row, 1]), np.float64(log_scales[row, 2])
            face = np.exp(a + b + c - min(a, b, c))
            faces[k] = face if np.isfinite(face) else 0.0
        largest = LARGEST * np.median(faces)
        weights, totals = np.empty(count), np.zeros((_CELLS, _CELLS, _CELLS))
        cells, seen = np.empty((count, 3), np.int64), np.zeros((_CELLS, _CELLS, _CELLS), np.bool_)
        for k in range(count):
            opacity = 1 / (1 + np.exp(-np.float64(opacity_logits[rows[bounds[part] + k]])))
            weight = opacity * min(faces[k], largest) + 1e-12
            weights[k] = weight if np.isfinite(weight + looks[k, 0] + looks[k, 1] + looks[k, 2]) else 0.0
            for axis in range(3):
                cell = np.int64(np.floor(looks[k, axis] / CELL)) - first[axis]
                cells[k, axis] = min(max(cell, 1), _CELLS - 2)
            totals[cells[k, 0], cells[k, 1], cells[k, 2]] += weights[k]
            seen[cells[k, 0], cells[k, 1], cells[k, 2]] = True
        x, y, z = _find_commonest(totals, seen, first)
        for _ in range(REFINEMENTS):
            total, u, v, w, red, green, blue = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for k in range(count):
                away = (looks[k, 0] - x) ** 2 + (looks[k, 1] - y) ** 2 + (looks[k, 2] - z) ** 2
                if weights[k] > 0 and away <= WIDEST**2:
                    weight = weights[k]
                    total += weight
                    u, v, w = u + weight * looks[k, 0], v + weight * looks[k, 1], w + weight * looks[k, 2]
                    red, green = red + weight * colors[k, 0], green + weight * colors[k, 1]
                    blue += weight * colors[k, 2]
            if total == 0:
                break
            x, y, z = u / total, v / total, w / total
            found[part, 0], found[part, 1], found[part, 2] = red / total, green / total, blue / total
