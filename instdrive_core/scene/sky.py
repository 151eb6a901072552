"""The sky: a cube map blended behind the Gaussians by 1 - alpha."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int32
from numpy import ndarray


@dataclass(frozen=True)
class Sky:
    """Six square faces in the order +x, -x, +y, -y, +z, -z of the world."""

    faces: Float32[ndarray, "6 r r 3"]
    """RGB in [0, 1]; row v and column u grow with the face's second and first tangent axis (see `cube_taps`)."""

    def colors(self, directions: Float[ndarray, "*n 3"]) -> Float32[ndarray, "*n 3"]:
        """Bilinear colour along world directions of any length."""
        indices, weights = cube_taps(directions.reshape(-1, 3), self.faces.shape[1])
        taken = self.faces.reshape(-1, 3)[indices]
        return np.einsum("nk,nkc->nc", weights, taken).reshape(*directions.shape[:-1], 3)


def cube_taps(
    directions: Float[ndarray, "n 3"], resolution: int
) -> tuple[Int32[ndarray, "n 4"], Float32[ndarray, "n 4"]]:
    """The four texels (row-major over 6 × resolution²) and bilinear weights that each direction reads.

    On a face of axis a the tangent axes are (a + 1) % 3 for columns and (a + 2) % 3 for rows; texel centres lie
    at +0.5 and lookups clamp at the face's border.
    """
    sizes = np.abs(directions)
    axis = np.argmax(sizes, axis=1)
    rows = np.arange(len(directions))
    major = directions[rows, axis]
    face = axis * 2 + (major < 0)
    scale = 0.5 / np.maximum(np.abs(major), 1e-12)
    u = (directions[rows, (axis + 1) % 3] * scale + 0.5) * resolution - 0.5
    v = (directions[rows, (axis + 2) % 3] * scale + 0.5) * resolution - 0.5
    u, v = np.clip(u, 0, resolution - 1), np.clip(v, 0, resolution - 1)
    u0 = np.minimum(u.astype(np.int32), max(resolution - 2, 0))
    v0 = np.minimum(v.astype(np.int32), max(resolution - 2, 0))
    du, dv = (u - u0).astype(np.float32), (v - v0).astype(np.float32)
    u1, v1 = np.minimum(u0 + 1, resolution - 1), np.minimum(v0 + 1, resolution - 1)
    base = (face * resolution * resolution).astype(np.int32)
    indices = [base + r * resolution + c for r, c in ((v0, u0), (v0, u1), (v1, u0), (v1, u1))]
    weights = [(1 - dv) * (1 - du), (1 - dv) * du, dv * (1 - du), dv * du]
    return np.stack(indices, axis=1), np.stack(weights, axis=1).astype(np.float32)
