"""Splats shown as what they are: as dots at their centres, or as ellipses with a rim.

Shaders of the editor do the same on a GPU (``project.vert`` for dots, ``rings.frag`` for rims).
"""

from __future__ import annotations

from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Float32, Int32
from numpy import ndarray

from instdrive_core.rasterize.kernels.fragment import EIGHTH
from instdrive_core.rasterize.kernels.settings import RasterSettings
from instdrive_core.rasterize.preview import PickRule
from instdrive_core.rasterize.preview.splats import AT_A, AT_B, AT_C, AT_COLOR, AT_OPACITY, AT_X, AT_Y, ProjectedSplats

DOT_SETTINGS = RasterSettings(low_pass=0.8)
"""Dots are what the low-pass makes of a point: about two pixels wide, as large near by as far away."""
RING_RULE = PickRule(nearest=True)
"""By it a pixel stands for the nearest ellipse over it, whatever lies behind."""
DOT_OPACITY = 0.99
DOT_LOG_SCALE = -30.0
"""Natural logarithm of a dot's standard deviation in metres: that of a point."""
RIM = 0.72
"""Part of the squared distance to an ellipse's edge from which its rim begins."""
INSIDE, RIM_LIGHT = 0.45, 0.2
"""Brightness of an ellipse inside its rim, relative to its colour, and what its rim is brighter."""


def make_dots(opacities: Float32[ndarray, " n"], min_opacity: float) -> Float32[ndarray, " n"]:
    """Opacities of splats shown as dots: alike for all that are opaque enough, 0 for the others."""
    return np.where(opacities >= max(min_opacity, 1e-6), np.float32(DOT_OPACITY), np.float32(0))


def paint_rings(
    found: ProjectedSplats,
    winner: Int32[ndarray, "h w"],
    min_alpha: float,
    behind: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Float32[ndarray, "h w 3"]:
    """Paint each pixel as part of the ellipse it stands for: its rim bright, its inside dark, opaque.

    Args:
        found: the projected splats with their colours, in the order of rows.
        winner: row of the splat that each pixel stands for, -1 for none.
        min_alpha: alpha at an ellipse's edge.
        behind: RGB where there is no splat.
    """
    picture = np.empty((*winner.shape, 3), np.float32)
    shading = np.array([min_alpha, RIM, INSIDE, RIM_LIGHT, *behind], np.float32)
    _paint(found.lines, winner, shading, picture)
    return picture


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
@no_type_check
def _paint(lines, winner, shading, picture):
    min_alpha, rim, inside, light = shading[0], shading[1], shading[2], shading[3]
    for y in numba.prange(winner.shape[0]):
        for x in range(winner.shape[1]):
            row = winner[y, x]
            if row < 0:
                for channel in range(3):
                    picture[y, x, channel] = shading[4 + channel]
                continue
            dx, dy = np.float32(x) - lines[row, AT_X], np.float32(y) - lines[row, AT_Y]
            u, v = lines[row, AT_A] * dx + lines[row, AT_B] * dy, lines[row, AT_C] * dy
            square = (u * u + v * v) / (np.float32(0.5) * EIGHTH)
            edge = np.float32(2) * np.log(max(lines[row, AT_OPACITY] / min_alpha, np.float32(1.0001)))
            on_rim = square > rim * edge
            for channel in range(np.uint64(3)):
                color = min(lines[row, AT_COLOR + channel], np.float32(1))
                picture[y, x, channel] = min(color + light, np.float32(1)) if on_rim else color * inside
