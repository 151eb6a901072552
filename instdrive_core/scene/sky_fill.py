"""Filling sky that no photo saw from the sky around it: smooth, and along the horizon rather than across it.

Below the horizon there is no sky: where no photo saw the ground, such as around the recording car, the ground's colour
shows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Float64
from numpy import ndarray
from scipy import ndimage

from instdrive_core.scene.sky import Sky, compute_texel_directions

SEEN, UNSEEN = 0.7, 0.3
"""Share of light that reached a photo: from the first on a texel keeps its colour, below the second it loses it."""
SEEN_BELOW, UNSEEN_BELOW = 0.1, 0.02
"""Less light counts below the horizon: the ground's colour differs more from what shone through thin ground."""
ROWS, COLUMNS = 64, 128
"""Cells from nadir to zenith and around, in which colours are spread."""
SPREADS = ((16.0, 64.0), (8.0, 32.0), (4.0, 12.0), (2.0, 5.0), (1.0, 1.5))
"""Standard deviations of the spreading in cells, upwards and around; finer ones count where they find colours."""
LOWEST_SOURCE = -0.1
"""Sine of the elevation below which a texel is no sky to copy: a photo saw it through a hole in the road."""
GROUND_BEGINS, GROUND_WHOLE = np.radians(0.5), np.radians(1.5)
"""Below the horizon: at the first the ground's colour begins, beyond the second it is whole. From the roof of a car the
ground lies 230 and 75 m away there: farther off, there is haze."""
_LITTLE = 1e-3


@dataclass(frozen=True)
class SkyEvidence:
    """What the photos of a scene saw of its sky, and of the ground."""

    light: Float32[ndarray, "6 r r"]
    """Largest share of light, 0 … 1, that reached a photo from each texel."""
    ground: Float64[ndarray, "3"] | None = None
    """Usual colour of the ground around the cameras, 0 … 1; None where there is none to speak of."""


def fill_unseen_sky(sky: Sky, evidence: SkyEvidence) -> Sky:
    """Give texels that no photo saw the colours of the sky around them.

    Below the horizon they get the ground's colour; where that is not known, the horizon's colours go on and fade to
    their mean. A sky that no light came from stays as it is.

    Args:
        sky: of a scene whose z points up.
        evidence: of the sky's own resolution.
    """
    kept = np.clip((evidence.light - UNSEEN) / (SEEN - UNSEEN), 0, 1)
    directions = compute_texel_directions(sky.faces.shape[1])
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    heights = directions[..., 2]
    if evidence.ground is not None:
        tinted = np.clip((evidence.light - UNSEEN_BELOW) / (SEEN_BELOW - UNSEEN_BELOW), 0, 1)
        kept = np.where(heights < -np.sin(GROUND_BEGINS), tinted, kept)
    weights = kept * (heights > LOWEST_SOURCE)
    if not weights.any():
        return sky
    rows = (np.arcsin(np.clip(heights, -1, 1)) / np.pi + 0.5) * ROWS - 0.5
    columns = (np.arctan2(directions[..., 1], directions[..., 0]) / (2 * np.pi) + 0.5) * COLUMNS - 0.5
    spread = _calm_poles(_spread_colors(rows, columns, weights, sky.faces), evidence.ground)
    # A margin of wrapped columns on both sides, so that colours go on across the seam.
    padded = np.concatenate([spread[:, -2:], spread, spread[:, :2]], axis=1)
    places = np.stack([np.clip(rows, 0, ROWS - 1), columns + 2])
    filled = np.stack([ndimage.map_coordinates(padded[..., c], places, order=1) for c in range(3)], axis=-1)
    faces = np.where(kept[..., None] >= 1, sky.faces, kept[..., None] * sky.faces + (1 - kept[..., None]) * filled)
    return Sky(faces.astype(np.float32))


def _spread_colors(
    rows: Float64[ndarray, "6 r r"],
    columns: Float64[ndarray, "6 r r"],
    weights: ndarray,
    faces: Float32[ndarray, "6 r r 3"],
) -> Float64[ndarray, "h w 3"]:
    """Colours of all cells, row 0 at the nadir: those of weighted texels in and around each cell."""
    cells = np.clip(np.rint(rows), 0, ROWS - 1).astype(int) * COLUMNS + np.rint(columns).astype(int) % COLUMNS
    cells, values = cells.ravel(), weights.ravel().astype(np.float64)
    support = np.bincount(cells, values, ROWS * COLUMNS).reshape(ROWS, COLUMNS)
    sums = np.stack(
        [np.bincount(cells, values * faces[..., c].ravel(), ROWS * COLUMNS).reshape(ROWS, COLUMNS) for c in range(3)],
        axis=-1,
    )
    colors = np.broadcast_to(sums.sum(axis=(0, 1)) / support.sum(), (ROWS, COLUMNS, 3)).copy()
    for spread in SPREADS:
        here = _blur(support, spread)
        mean = np.stack([_blur(sums[..., c], spread) for c in range(3)], axis=-1) / np.maximum(here, 1e-12)[..., None]
        share = (here / (here + _LITTLE))[..., None]
        colors = share * mean + (1 - share) * colors
    return colors


def _blur(values: Float64[ndarray, "h w"], spread: tuple[float, float]) -> Float64[ndarray, "h w"]:
    upwards = ndimage.gaussian_filter1d(values, spread[0], axis=0, mode="nearest")
    return np.asarray(ndimage.gaussian_filter1d(upwards, spread[1], axis=1, mode="wrap"))


def _calm_poles(colors: Float64[ndarray, "h w 3"], ground: Float64[ndarray, "3"] | None) -> Float64[ndarray, "h w 3"]:
    """Let cells near the zenith agree around it, and cells below the horizon follow the horizon, or be ground."""
    elevations = ((np.arange(ROWS) + 0.5) / ROWS - 0.5) * np.pi
    heights, middle = np.sin(elevations), ROWS // 2
    horizon = colors[middle].copy()
    if ground is None:
        below, lowest = np.clip(-heights[:middle], 0, 1) ** 0.5, horizon.mean(axis=0)
    else:
        below, lowest = (-elevations[:middle] - GROUND_BEGINS) / (GROUND_WHOLE - GROUND_BEGINS), ground
    share = np.clip(below, 0, 1)[:, None, None]
    colors[:middle] = (1 - share) * horizon + share * lowest
    calm = np.clip(heights, 0, 1)[:, None, None] ** 8
    return (1 - calm) * colors + calm * colors.mean(axis=1, keepdims=True)
