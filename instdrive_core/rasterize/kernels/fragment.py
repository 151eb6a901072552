"""One splat at one pixel: α′ = opacity · exp(-½ dᵀ·conic·d), written so that the loop over a tile's pixels vectorises.

The exponent is kept in eighths of a power of two: it lies in [-1, 0] for every fragment that is not skipped
(1/255 > 2⁻⁸), there a polynomial of degree five gives 2ˣ to 8e-8, and three squarings undo the eighth.
"""

from __future__ import annotations

import numba
import numpy as np

from instdrive_core.rasterize.kernels.project import CONIC_XX, CONIC_XY, CONIC_YY, MEAN_X, MEAN_Y, POWER_LIMIT

FAST = {"nnan", "ninf", "nsz", "arcp", "contract", "afn"}
"""fastmath flags of the blending loops. Projected splats are finite, so nnan and ninf hold."""

FLOOR = np.float32(-1.002)
"""Exponents (in eighths) are clamped here, below any alpha that is drawn."""
EIGHTH = np.float32(0.125 * np.log2(np.e))
"""Factor from natural exponents to eighths of a power of two."""


def _exponential_coefficients() -> tuple[np.float32, ...]:
    """Least-squares fit of the relative error on Chebyshev nodes of the range, lowest degree first."""
    nodes = 0.5 * float(FLOOR) * (1 - np.cos(np.pi * (np.arange(4000) + 0.5) / 4000))
    powers = np.vander(nodes, 6, increasing=True)
    solution = np.linalg.lstsq(powers / 2.0 ** nodes[:, None], np.ones(len(nodes)), rcond=None)[0]
    return tuple(np.float32(value) for value in solution)


_C0, _C1, _C2, _C3, _C4, _C5 = _exponential_coefficients()


@numba.njit(cache=True, error_model="numpy", fastmath=FAST)
def power_of_two(eighths):
    """2^(8·eighths) for eighths in [FLOOR, 0]."""
    root = _C0 + eighths * (_C1 + eighths * (_C2 + eighths * (_C3 + eighths * (_C4 + eighths * _C5))))
    square = root * root
    fourth = square * square
    return fourth * fourth


@numba.njit(cache=True, error_model="numpy", fastmath=FAST)
def compute_exponent(splats, v, left, top, min_alpha):
    """Compute a splat's exponent as (mean x, mean y, base, xx, xy, yy), relative to the centre of pixel (left, top).

    The exponent in eighths at offset (dx, dy) is base + yy·dy² + dx·(xy·dy + xx·dx).
    """
    base = np.float32(0.5) * EIGHTH * splats[v, POWER_LIMIT] + np.float32(0.125) * np.log2(min_alpha)
    return (
        splats[v, MEAN_X] - np.float32(0.5) - left,
        splats[v, MEAN_Y] - np.float32(0.5) - top,
        base,
        np.float32(-0.5) * EIGHTH * splats[v, CONIC_XX],
        -EIGHTH * splats[v, CONIC_XY],
        np.float32(-0.5) * EIGHTH * splats[v, CONIC_YY],
    )
