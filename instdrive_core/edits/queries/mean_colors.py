"""Mean colours of instances, all of them in one walk over their rows."""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float, Float64, UInt16
from numpy import ndarray

from instdrive_core.edits.document.row_parts import RowParts
from instdrive_core.maths.activations import sigmoid
from instdrive_core.maths.spherical_harmonics import Y0
from instdrive_core.scene.gaussians import Gaussians

IDENTITY = np.eye(3, 4, dtype=np.float32)[None]
_LARGE_SHARE = 8
"""Where more than one row of so many counts, all rows are walked in the order in which they are stored."""


def compute_mean_colors(
    gaussians: Gaussians,
    parts: RowParts,
    maps: Float[ndarray, "p 3 4"] = IDENTITY,
    indices: UInt16[ndarray, " n"] | None = None,
) -> Float64[ndarray, "k 3"]:
    """The mean colour of each part, without view dependence and not below black, weighted by opacity.

    `indices` say which of the `maps` [A | b] the colour of each of the scene's rows goes through first; without them it
    is the first.
    """
    count, owners = len(gaussians), np.repeat(np.arange(len(parts), dtype=np.int32), parts.sizes)
    if _LARGE_SHARE * len(parts.rows) > count:
        # What is read lies side by side; each part's rows come in the same order as below.
        rows, owner = slice(None), np.full(count, -1, np.int32)
        owner[parts.rows] = owners
    else:
        rows, owner = parts.rows, owners
    weights = sigmoid(gaussians.opacity_logits[rows])
    through = np.zeros(len(weights), np.uint16) if indices is None else np.array(indices[rows])
    sums = np.zeros((len(parts), 4))
    _add_colors(sums, owner, gaussians.sh_dc[rows], weights, np.ascontiguousarray(maps, np.float64), through)
    return sums[:, :3] / np.maximum(sums[:, 3:], 1e-12)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _add_colors(sums, owner, sh_dc, weights, maps, through):
    """Add the mapped colour of each row, times its weight, and the weight to the sums of its owner (-1 = none)."""
    for row in range(np.uint64(len(owner))):
        if owner[row] < 0:
            continue
        part, m, weight = np.uint64(owner[row]), np.uint64(through[row]), np.float64(weights[row])
        r, g, b = 0.5 + Y0 * sh_dc[row, 0], 0.5 + Y0 * sh_dc[row, 1], 0.5 + Y0 * sh_dc[row, 2]
        sums[part, 0] += weight * max(maps[m, 0, 0] * r + maps[m, 0, 1] * g + maps[m, 0, 2] * b + maps[m, 0, 3], 0.0)
        sums[part, 1] += weight * max(maps[m, 1, 0] * r + maps[m, 1, 1] * g + maps[m, 1, 2] * b + maps[m, 1, 3], 0.0)
        sums[part, 2] += weight * max(maps[m, 2, 0] * r + maps[m, 2, 1] * g + maps[m, 2, 2] * b + maps[m, 2, 3], 0.0)
        sums[part, 3] += weight
