"""Colours of a preview's visible splats, recoloured, written into the lines of `ProjectedSplats`."""

from __future__ import annotations

from dataclasses import dataclass, field

import numba
import numpy as np
from jaxtyping import Float, Float32, Int32, UInt16
from numpy import ndarray

from instdrive_core.maths.spherical_harmonics import Y0
from instdrive_core.rasterize.kernels.layout import to_kernel_array
from instdrive_core.rasterize.kernels.simd import prefetch
from instdrive_core.rasterize.kernels.view_colors import fill_basis
from instdrive_core.rasterize.preview.splats import ProjectedSplats

_CHUNK = 1 << 7
"""Rows whose basis values lie side by side, so that the loops over them vectorise; few enough that their coefficients,
fetched beforehand, stay in a core's own cache."""
_LINE = np.uint64(16)
"""Floats per cache line."""
_Y0, _HALF = np.float32(Y0), np.float32(0.5)


@dataclass(frozen=True)
class ColorSource:
    """Harmonics of splats and their recolouring."""

    sh_dc: Float32[ndarray, "n 3"]
    sh_rest: Float32[ndarray, "n k 3"]
    frames: Int32[ndarray, " n"]
    """Index into `rotations` of the one that turns a splat's harmonics; empty where none does."""
    rotations: Float32[ndarray, "f 3 3"]
    """world_from_frame."""
    entries: UInt16[ndarray, " n"]
    """Entry of the colour palette; 0 changes nothing."""
    matrices: Float32[ndarray, "p 3 4"]
    """[A | b] of each entry: max(A c + b, 0) is shown for c."""
    sources: Int32[ndarray, " n"] = field(default_factory=lambda: np.zeros(0, np.int32))
    """Row of `sh_dc` and `sh_rest` that each splat takes; empty where they lie in the same order."""


def write_colors(
    found: ProjectedSplats, source: ColorSource, means: Float32[ndarray, "n 3"], camera_position: Float[ndarray, "3"]
) -> None:
    """Write RGB (≥ 0) of every visible row along the direction from the camera to it."""
    harmonics = (to_kernel_array(source.sh_dc), to_kernel_array(source.sh_rest))
    turned = (source.frames, to_kernel_array(source.rotations))
    recolored = (np.require(source.entries, np.uint16, ["C", "W"]), to_kernel_array(source.matrices))
    place = (means, to_kernel_array(camera_position))
    _write(place, (*harmonics, source.sources), turned, recolored, found.depths, found.colors)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _fill_directions(rows, count, place, turned, directions):
    """Unit directions from the camera to some splats, each in its own frame."""
    means, position = place
    frames, rotations = turned
    for at in range(np.uint64(count)):
        row = np.uint64(rows[at])
        for axis in range(3):
            directions[axis, at] = means[row, axis] - position[axis]
    if len(frames):
        for at in range(np.uint64(count)):
            f = np.uint64(frames[np.uint64(rows[at])])
            x, y, z = directions[0, at], directions[1, at], directions[2, at]
            for axis in range(3):
                directions[axis, at] = rotations[f, 0, axis] * x + rotations[f, 1, axis] * y + rotations[f, 2, axis] * z
    for at in range(np.uint64(count)):
        x, y, z = directions[0, at], directions[1, at], directions[2, at]
        scale = np.float32(1) / np.sqrt(max(x * x + y * y + z * z, np.float32(1e-12)))
        directions[0, at], directions[1, at], directions[2, at] = x * scale, y * scale, z * scale


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _sum_up(rows, count, harmonics, basis, recolored, colors):
    sh_dc, sh_rest, sources = harmonics
    entries, matrices = recolored
    zero = np.float32(0)
    for at in range(np.uint64(count)):
        i = np.uint64(rows[at])
        j = np.uint64(sources[i]) if len(sources) else i
        red, green, blue = _HALF + _Y0 * sh_dc[j, 0], _HALF + _Y0 * sh_dc[j, 1], _HALF + _Y0 * sh_dc[j, 2]
        for k in range(np.uint64(len(basis))):
            value = basis[k, at]
            red += value * sh_rest[j, k, 0]
            green += value * sh_rest[j, k, 1]
            blue += value * sh_rest[j, k, 2]
        entry = np.uint64(entries[i])
        if entry:
            m = matrices[entry]
            red, green, blue = (
                m[0, 0] * red + m[0, 1] * green + m[0, 2] * blue + m[0, 3],
                m[1, 0] * red + m[1, 1] * green + m[1, 2] * blue + m[1, 3],
                m[2, 0] * red + m[2, 1] * green + m[2, 2] * blue + m[2, 3],
            )
        colors[i, 0], colors[i, 1], colors[i, 2] = max(red, zero), max(green, zero), max(blue, zero)


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy", fastmath=True)
def _write(place, harmonics, turned, recolored, depths, colors):
    count, width, coefficients = len(depths), np.uint64(3 * harmonics[1].shape[1]), harmonics[1].reshape(-1)
    for chunk in numba.prange((count + _CHUNK - 1) // _CHUNK):
        rows, visible = np.empty(_CHUNK, np.int64), 0
        for row in range(chunk * _CHUNK, min((chunk + 1) * _CHUNK, count)):
            if depths[row] > np.float32(0):
                rows[visible] = row
                visible += 1
                source = np.uint64(harmonics[2][row]) if len(harmonics[2]) else np.uint64(row)
                for line in range(np.uint64(0), width, _LINE):
                    prefetch(coefficients, source * width + line)
        directions, basis = np.empty((3, _CHUNK), np.float32), np.empty((harmonics[1].shape[1], _CHUNK), np.float32)
        if len(basis) and visible:
            _fill_directions(rows, visible, place, turned, directions)
            fill_basis(visible, directions, basis)
        _sum_up(rows, visible, harmonics, basis, recolored, colors)
