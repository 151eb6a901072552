"""The sky: a cube map blended behind the Gaussians by 1 - alpha."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from jaxtyping import Float, Float32, Float64, Int32
from numpy import ndarray


@dataclass(frozen=True)
class Sky:
    """Six square faces in the order +x, -x, +y, -y, +z, -z of the world."""

    faces: Float32[ndarray, "6 r r 3"]
    """RGB in [0, 1]; row v and column u grow with the face's second and first tangent axis (see `find_cube_taps`)."""

    def sample(self, directions: Float[ndarray, "*n 3"]) -> Float32[ndarray, "*n 3"]:
        """Sample the colours along world directions of any length, bilinearly."""
        indices, weights = find_cube_taps(directions.reshape(-1, 3), self.faces.shape[1])
        taken = self.faces.reshape(-1, 3)[indices]
        return np.einsum("nk,nkc->nc", weights, taken).reshape(*directions.shape[:-1], 3)


def compute_texel_directions(resolution: int) -> Float64[ndarray, "6 {resolution} {resolution} 3"]:
    """Compute world directions, of lengths 1 to √3, through the middles of all texels in the order of `Sky.faces`."""
    across = (np.arange(resolution) + 0.5) * 2 / resolution - 1
    directions = np.empty((6, resolution, resolution, 3))
    for face in range(6):
        axis, sign = face // 2, 1 - 2 * (face % 2)
        directions[face, ..., axis] = sign
        directions[face, ..., (axis + 1) % 3] = across
        directions[face, ..., (axis + 2) % 3] = across[:, None]
    return directions


def find_cube_taps(
    directions: Float[ndarray, "n 3"], resolution: int
) -> tuple[Int32[ndarray, "n 4"], Float32[ndarray, "n 4"]]:
    """Find the four texels (row-major over 6 × resolution²) and bilinear weights that each direction reads.

    On a face of axis a the tangent axes are (a + 1) % 3 for columns and (a + 2) % 3 for rows; texel centres lie
    at +0.5 and lookups clamp at the face's border.
    """
    directions = np.ascontiguousarray(directions, np.float32)
    indices, weights = np.empty((len(directions), 4), np.int32), np.empty((len(directions), 4), np.float32)
    _find_cube_taps(directions, resolution, indices, weights)
    return indices, weights


@numba.njit(error_model="numpy", cache=True)
def _find_cube_taps(directions, resolution, indices, weights):
    for i in range(len(directions)):
        find_cube_tap(directions[i, 0], directions[i, 1], directions[i, 2], resolution, indices[i], weights[i])


@numba.njit(error_model="numpy", cache=True)
def find_cube_tap(x, y, z, resolution, indices, weights):
    """Find the taps of one direction, for other kernels; writes 4 texels and 4 weights."""
    axis, major, first, second = 2, z, x, y
    if abs(x) >= abs(y) and abs(x) >= abs(z):
        axis, major, first, second = 0, x, y, z
    elif abs(y) >= abs(z):
        axis, major, first, second = 1, y, z, x
    face = axis * 2 + (1 if major < 0 else 0)
    scale = 0.5 / max(abs(major), 1e-12)
    u, v = (first * scale + 0.5) * resolution - 0.5, (second * scale + 0.5) * resolution - 0.5
    u, v = min(max(u, 0.0), resolution - 1.0), min(max(v, 0.0), resolution - 1.0)
    column, row = min(int(u), max(resolution - 2, 0)), min(int(v), max(resolution - 2, 0))
    du, dv = u - column, v - row
    right, below = min(column + 1, resolution - 1), min(row + 1, resolution - 1)
    base = face * resolution * resolution
    indices[0], weights[0] = base + row * resolution + column, (1 - dv) * (1 - du)
    indices[1], weights[1] = base + row * resolution + right, (1 - dv) * du
    indices[2], weights[2] = base + below * resolution + column, dv * (1 - du)
    indices[3], weights[3] = base + below * resolution + right, dv * du
