"""The darkness that a thing throws on the ground, and the dark splats that show it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64
from numpy import ndarray
from scipy import ndimage

CELL = 0.3
"""Metres from one dark splat to the next: far enough that a camera far away does not see each as larger than it is."""
_SPREAD = 1.0
"""Standard deviation of a dark splat, in cells: they overlap so much that each is faint, which keeps them out of what
counts solid splats only, such as boxes, feet and the instance that a pixel shows."""
_OVERLAP = 2 * np.pi * _SPREAD**2
"""Sum of the splats' weights anywhere on a lattice of them."""
MAX_DARKNESS = 0.85
"""Share of the light that a shadow takes away at most: some comes from all sides."""
_LOW = 1.0
"""Metres above the ground up to which a thing shades it from all sides."""
_MAX_CELLS = 160
"""Cells along an axis at most: what is larger than 40 m casts no shadow of its own."""
_LEAST = 0.02
"""Darkness below which no splat is laid."""
_PARTS = 3
"""Cells of the outline along a cell of the shadow."""
_GAP = 0.6
"""Metres that lie between two of a thing's splats at most without being lit."""


@dataclass(frozen=True)
class SceneLight:
    """What shadows look like in a scene."""

    contact: float = 0.6
    """Share of the light that does not reach the ground below a thing, 0 … 1."""
    sun: tuple[float, float] = (0.0, 0.0)
    """Metres along x and y by which a shadow lies beside what is a metre above the ground; 0, 0 = no sun."""
    sun_share: float = 0.0
    """Share of the light that the sun's shadow takes away."""
    softness: float = 0.2
    """Standard deviation of a shadow's edge, metres."""


@dataclass(frozen=True)
class Shade:
    """Ground that is darker because of a thing."""

    places: Float64[ndarray, "k 2"]
    """World x and y, metres."""
    darkness: Float64[ndarray, " k"]
    """Share of the light that is taken away."""


def cast_shade(points: Float64[ndarray, "n 3"], light: SceneLight) -> Shade:
    """Cast the shade of a thing, whose solid splats are `points`: x and y in the world, z above the ground (metres).

    Nothing where the thing is too large or nowhere near the ground.
    """
    low = points[:, 2] < _LOW
    thrown = points[:, :2] + np.clip(points[:, 2:], 0, None) * np.array(light.sun)
    reach = np.concatenate([points[low, :2], thrown])
    margin = 3 * light.softness + 2 * CELL
    corner = reach.min(axis=0) - margin
    shape = np.ceil((reach.max(axis=0) + margin - corner) / CELL).astype(int) + 1
    if not low.any() or shape.max() > _MAX_CELLS:
        return Shade(np.zeros((0, 2)), np.zeros(0))
    fine = shape * _PARTS
    below = _fill(points[low, :2], corner, fine, CELL / _PARTS)
    lit = 1 - light.contact * _soften(below, light.softness)
    if any(light.sun):
        thrown_cells = _fill(thrown, corner, fine, CELL / _PARTS) | below
        lit *= 1 - light.sun_share * _soften(thrown_cells, light.softness / 2)
    darkness = 1 - lit.reshape(shape[0], _PARTS, shape[1], _PARTS).mean(axis=(1, 3))
    cells = np.argwhere(darkness > _LEAST)
    return Shade(corner + CELL * (cells + 0.5), darkness[tuple(cells.T)])


def find_thrown_cells(
    points: Float64[ndarray, "n 3"],
    sun: tuple[float, float],
    corner: Float64[ndarray, "2"],
    shape: ndarray,
    size: float,
) -> Bool[ndarray, "a b"]:
    """Cells of `size` metres in which the sun's shadow of solid splats (as in `cast_shade`) lies."""
    thrown = points[:, :2] + np.clip(points[:, 2:], 0, None) * np.array(sun)
    return _fill(thrown, corner, shape, size)


def compute_opacities(shade: Shade) -> Float64[ndarray, " k"]:
    """Opacities with which overlapping black splats take that share of the light away."""
    return -np.expm1(np.log1p(-np.clip(shade.darkness, 0, MAX_DARKNESS)) / _OVERLAP)


def compute_spread() -> float:
    """Standard deviation of a dark splat along the ground, metres."""
    return _SPREAD * CELL


def _fill(
    places: Float64[ndarray, "n 2"], corner: Float64[ndarray, "2"], shape: ndarray, size: float
) -> Bool[ndarray, "a b"]:
    """Cells with splats, and those between them."""
    cells = np.floor((places - corner) / size).astype(int)
    inside = ((cells >= 0) & (cells < shape)).all(axis=1)
    taken = np.zeros(tuple(shape), bool)
    taken[tuple(cells[inside].T)] = True
    gap = max(1, round(_GAP / 2 / size))
    padded = np.pad(taken, gap)
    closed = np.asarray(ndimage.binary_closing(padded, np.ones((3, 3)), iterations=gap), bool)
    whole = np.asarray(ndimage.binary_fill_holes(closed), bool)
    return whole[gap:-gap, gap:-gap]


def _soften(cells: Bool[ndarray, "a b"], metres: float) -> Float64[ndarray, "a b"]:
    """Edges as soft as asked for, the splats' own softness included."""
    extra = np.sqrt(max(metres**2 - compute_spread() ** 2, 0.0)) * _PARTS / CELL
    return np.asarray(ndimage.gaussian_filter(cells.astype(np.float64), extra, mode="constant"))
