"""The shadow that a deleted thing cast on the ground, and ground in the shadow of anything."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool
from numpy import ndarray
from scipy import ndimage

from instdrive_core.edits.holes.ground_cells import grow_cells
from instdrive_core.edits.holes.ground_map import GroundMap, find_solid_cells

SHADOW_REACH = 2.0
"""Metres around what was deleted within which its shadow is looked for."""
SHADOW_SHARE = 0.65
"""Ground darker than this share of lit ground is in shadow."""
HALF_LIT_SHARE = 0.85
"""Ground darker than this share of lit ground, beside a shadow, lies in its soft edge."""
LIT_QUANTILE = 0.7
"""Quantile of the brightness of ground along the lane that is taken for lit."""
DARKEST_LIT = 0.8
"""Ground in the sun along any line is at least this share as bright as elsewhere."""
MIN_SHADOW = 0.4
"""Square metres: smaller dark places are stains."""
SHADE_GAP, SHADE_BAND = 1.0, 2.0
"""Metres between a hole and the ground that tells in what light it lies, and how far that reaches beyond the reach of
the shadow of what stood there."""
MIN_LIT = 50
"""Cells of ground that must be known to tell."""
FOREIGN_SHARE = 0.25
"""A dark place with more than this share outside of that reach is not the shadow of what was deleted."""


def find_cast_shadow(
    ground: GroundMap, clean: Bool[ndarray, "a b"], footprint: Bool[ndarray, "a b"], hole: Bool[ndarray, "a b"]
) -> Bool[ndarray, "a b"]:
    """Dark ground, though not of the hole, that hangs together with the hole and ends close around what stood there.

    Shade that reaches farther is a house's or a tree's, and stays.
    """
    size = ground.grid.size
    near = grow_cells(footprint, size, SHADOW_REACH)
    seen = find_solid_cells(ground) & ~ground.obstructed & ~hole
    if np.count_nonzero(clean) < MIN_LIT or not footprint.any():
        return np.zeros_like(hole)
    dark = seen & find_shaded_cells(ground, clean)
    parts = np.zeros(hole.shape, np.int32)
    ndimage.label(dark, np.ones((3, 3)), parts)
    # Its own sides may stand between the ground below it and the shadow beside it.
    sides = ground.obstructed & grow_cells(footprint, size, size)
    touching = np.unique(parts[dark & grow_cells(footprint | sides | hole, size, 1.5 * size)])
    shadow = np.zeros_like(hole)
    for part in touching[touching > 0].tolist():
        cells = parts == part
        if np.count_nonzero(cells) * size**2 < MIN_SHADOW:
            continue
        if np.count_nonzero(cells & ~near) <= FOREIGN_SHARE * np.count_nonzero(cells):
            shadow |= cells & near
    # Its rim is half lit.
    return (grow_cells(shadow, size, size) & seen & near) if shadow.any() else shadow


def find_shaded_cells(
    ground: GroundMap, clean: Bool[ndarray, "a b"], share: float = SHADOW_SHARE
) -> Bool[ndarray, "a b"]:
    """Cells darker than a `share` of ground in the sun. Each line along the lane has its own: marks and pavements are
    brighter; yet a line is not taken to be dark because most of it is in shadow. `clean` ground is what is compared
    with."""
    brightness = ground.color.mean(axis=2)
    if not clean.any():
        return np.zeros_like(clean)
    everywhere = np.quantile(brightness[clean], LIT_QUANTILE)
    lit = np.full(clean.shape[1], everywhere)
    enough = clean.sum(axis=0) >= MIN_LIT // 2
    lines = np.where(clean, brightness, np.nan)[:, enough]
    lit[enough] = np.maximum(np.nanquantile(lines, LIT_QUANTILE, axis=0), DARKEST_LIT * everywhere)
    return brightness < share * lit


def lies_in_shade(
    shaded: Bool[ndarray, "a b"], known: Bool[ndarray, "a b"], hole: Bool[ndarray, "a b"], size: float
) -> bool:
    """Whether most of the `known` ground around a hole is `shaded`, by a house, say: a thing there casts no shadow of
    its own, and ground in the sun must not be copied there. Cells are `size` metres."""
    around = known & grow_cells(hole, size, SHADOW_REACH + SHADE_BAND) & ~grow_cells(hole, size, SHADE_GAP)
    return bool(np.count_nonzero(shaded & around) > np.count_nonzero(around) / 2)
