"""Real spherical harmonics up to degree 3, in the sign and order convention of 3DGS.

Colour = 0.5 + Y0 · sh_dc + Σ Y_k(direction) · sh_rest_k, clamped below at 0 (Kerbl et al. 2023).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray

Y0 = 0.28209479177387814
REST_COUNTS = (0, 3, 8, 15)
"""Number of `sh_rest` coefficients per degree 0…3."""


def dc_from_color(colors: Float[ndarray, "*n 3"]) -> Float[ndarray, "*n 3"]:
    """Compute the constant coefficients that show `colors` ([0, 1]) from everywhere."""
    return (colors - 0.5) / Y0


def color_from_dc(sh_dc: Float[ndarray, "*n 3"]) -> Float[ndarray, "*n 3"]:
    """Compute the view-independent colour, which may leave [0, 1]."""
    return 0.5 + Y0 * sh_dc


def evaluate_rest_basis(directions: Float[ndarray, "n 3"], count: int) -> Float[ndarray, "n {count}"]:
    """Evaluate the first `count` (0, 3, 8 or 15) basis functions above the constant.

    `directions` are unit vectors from the camera to the Gaussian.
    """
    x, y, z = directions.T
    xx, yy, zz, xy, yz, xz = x * x, y * y, z * z, x * y, y * z, x * z
    values = [-0.4886025119029199 * y, 0.4886025119029199 * z, -0.4886025119029199 * x]
    if count > 3:
        values += [
            1.0925484305920792 * xy,
            -1.0925484305920792 * yz,
            0.31539156525252005 * (2 * zz - xx - yy),
            -1.0925484305920792 * xz,
            0.5462742152960396 * (xx - yy),
        ]
    if count > 8:
        values += [
            -0.5900435899266435 * y * (3 * xx - yy),
            2.890611442640554 * xy * z,
            -0.4570457994644658 * y * (4 * zz - xx - yy),
            0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy),
            -0.4570457994644658 * x * (4 * zz - xx - yy),
            1.445305721320277 * z * (xx - yy),
            -0.5900435899266435 * x * (xx - 3 * yy),
        ]
    if count == 0:
        return np.zeros((len(directions), 0), directions.dtype)
    return np.stack(values, axis=-1)


def evaluate_view_colors(
    sh_dc: Float[ndarray, "n 3"], sh_rest: Float[ndarray, "n k 3"], directions: Float[ndarray, "n 3"]
) -> Float[ndarray, "n 3"]:
    """Evaluate the RGB (≥ 0) of each Gaussian seen along its unit direction camera → Gaussian."""
    colors = color_from_dc(sh_dc)
    if sh_rest.shape[1]:
        colors = colors + np.einsum("nk,nkc->nc", evaluate_rest_basis(directions, sh_rest.shape[1]), sh_rest)
    return np.maximum(colors, 0).astype(sh_dc.dtype)
