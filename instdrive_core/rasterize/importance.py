"""The splats that matter most from a place: a picture of them alone comes faster and is nearly the same."""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from instdrive_core.maths.workspace import Workspace
from instdrive_core.rasterize.kernels.project import camera_to_row
from instdrive_core.rasterize.kernels.settings import RasterSettings
from instdrive_core.scene.camera import Camera

_KEYS = 256
_CHUNK = 1 << 14
_STEPS = np.float32(8)
"""Keys per factor of two."""
_FAINTEST = np.float32(-16)
"""Binary logarithm of the least importance that is told from none."""


def select_most_important(
    means: Float32[ndarray, "n 3"],
    areas: Float32[ndarray, " n"],
    opacities: Float32[ndarray, " n"],
    camera: Camera,
    budget: int,
    settings: RasterSettings,
    workspace: Workspace,
) -> Float32[ndarray, " n"]:
    """Select about the `budget` most important splats in the view: returns opacities, 0 for all others.

    Importance is opacity times area in the picture; splats whose importance is equal to an eighth of a power of two
    are taken or left together, and none is left where all fit.

    Args:
        areas: product of the two longer standard deviations, m².
        budget: how many splats are wanted.
    """
    count = len(means)
    keys, kept = workspace.get_array("importance", (count,), np.uint8), workspace.get_array("important", (count,))
    histograms = np.zeros((-(-count // _CHUNK), _KEYS), np.int64)
    view = camera_to_row(camera)
    _rank((means, areas, opacities), view, settings.to_row(), keys, histograms)
    from_top = np.cumsum(histograms.sum(axis=0)[:0:-1])  # of keys 255 … 1; key 0 is out of view
    least = _KEYS - 1 - int(np.searchsorted(from_top, budget, side="right"))
    _keep(keys, np.uint8(min(max(least + 1, 1), _KEYS - 1)), opacities, kept)
    return kept


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy", fastmath={"nsz", "arcp", "contract", "afn"})
def _rank(splats, view, constants, keys, histograms):
    near, low_pass, min_alpha = constants[0], constants[1], constants[2]
    fx, fy, cx, cy, width, height = view[12], view[13], view[14], view[15], view[16], view[17]
    one, three = np.float32(1), np.float32(3)
    for chunk in numba.prange(len(histograms)):
        for i in range(np.uint64(chunk * _CHUNK), np.uint64(min((chunk + 1) * _CHUNK, len(keys)))):
            keys[i] = 0
            mx, my, mz = splats[0][i, 0], splats[0][i, 1], splats[0][i, 2]
            z = view[6] * mx + view[7] * my + view[8] * mz + view[11]
            opacity = splats[2][i]
            if not (z > near and opacity >= min_alpha):
                continue
            rz = one / z
            area = fx * fy * splats[1][i] * rz * rz + low_pass
            x = fx * (view[0] * mx + view[1] * my + view[2] * mz + view[9]) * rz + cx
            y = fy * (view[3] * mx + view[4] * my + view[5] * mz + view[10]) * rz + cy
            reach = three * np.sqrt(area)
            if not (x + reach > 0 and x - reach < width and y + reach > 0 and y - reach < height):
                continue
            key = np.int64(_STEPS * (np.log2(opacity * area) - _FAINTEST))
            key = min(max(key, 1), _KEYS - 1)
            keys[i] = key
            histograms[chunk, key] += 1


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def _keep(keys, least, opacities, kept):
    for i in numba.prange(len(keys)):
        kept[i] = opacities[i] if keys[i] >= least else np.float32(0)
