"""Colours of Gaussians seen from a place: spherical harmonics evaluated in parallel, and the gradient of that.

The formulas are those of `maths.spherical_harmonics`; a test holds the two together.
"""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float, Float32, UInt16
from numpy import ndarray

from instdrive_core.maths.spherical_harmonics import Y0
from instdrive_core.rasterize.layout import kernel_array
from instdrive_core.scene.scene import node_rotations

_CHUNK = 1 << 12
_Y0 = np.float32(Y0)
_HALF = np.float32(0.5)


def view_colors(
    means: Float[ndarray, "n 3"],
    sh_dc: Float[ndarray, "n 3"],
    sh_rest: Float[ndarray, "n k 3"],
    camera_position: Float[ndarray, "3"],
    nodes: UInt16[ndarray, " n"] | None = None,
    poses: Float[ndarray, "m 4 4"] | None = None,
) -> Float32[ndarray, "n 3"]:
    """RGB (≥ 0) of each Gaussian along the direction from the camera to it.

    Args:
        means: in the world, actors placed.
        nodes: node of each row, 0 = background; with `poses`, an actor's harmonics turn with it: they are looked up
            along the direction in the actor's frame.
        poses: world_from_node, as `Scene.at` gives them.
    """
    colors = np.empty((len(means), 3), np.float32)
    _colors(_arguments(means, sh_dc, sh_rest, camera_position, nodes, poses), colors)
    return colors


def view_colors_backward(
    means: Float[ndarray, "n 3"],
    sh_dc: Float[ndarray, "n 3"],
    sh_rest: Float[ndarray, "n k 3"],
    camera_position: Float[ndarray, "3"],
    nodes: UInt16[ndarray, " n"] | None,
    poses: Float[ndarray, "m 4 4"] | None,
    grad_colors: Float[ndarray, "n 3"],
) -> tuple[Float32[ndarray, "n 3"], Float32[ndarray, "n k 3"]]:
    """Gradients with respect to `sh_dc` and `sh_rest`, given that of the colours.

    None flows through the direction into the means: it is small beside that of the projection, and 3DGS trains
    as well without it. Channels clamped at 0 send none back.
    """
    grad_dc, grad_rest = np.zeros(sh_dc.shape, np.float32), np.zeros(sh_rest.shape, np.float32)
    arguments = _arguments(means, sh_dc, sh_rest, camera_position, nodes, poses)
    _colors_backward(arguments, kernel_array(grad_colors), grad_dc, grad_rest)
    return grad_dc, grad_rest


def _arguments(
    means: ndarray,
    sh_dc: ndarray,
    sh_rest: ndarray,
    position: ndarray,
    nodes: ndarray | None,
    poses: ndarray | None,
) -> tuple[ndarray, ...]:
    if nodes is None or poses is None or len(poses) < 2:
        nodes, rotations = np.zeros(0, np.uint16), np.eye(3, dtype=np.float32)[None]
    else:
        rotations = node_rotations(np.asarray(poses, np.float64))
    floats = (kernel_array(array) for array in (means, sh_dc, sh_rest, position))
    return *floats, np.require(nodes, np.uint16, ["C", "W"]), kernel_array(rotations)


@numba.njit(cache=True, error_model="numpy", fastmath=True)
def _fill_basis(basis, means, i, position, nodes, rotations):
    """Write the basis values above the constant for Gaussian i, in the node's own frame."""
    x, y, z = means[i, 0] - position[0], means[i, 1] - position[1], means[i, 2] - position[2]
    if len(nodes) and nodes[i]:
        r = rotations[nodes[i]]
        x, y, z = (
            r[0, 0] * x + r[1, 0] * y + r[2, 0] * z,
            r[0, 1] * x + r[1, 1] * y + r[2, 1] * z,
            r[0, 2] * x + r[1, 2] * y + r[2, 2] * z,
        )
    scale = np.float32(1) / np.sqrt(max(x * x + y * y + z * z, np.float32(1e-12)))
    x, y, z = x * scale, y * scale, z * scale
    count = len(basis)
    if count >= 3:
        basis[0] = np.float32(-0.4886025119029199) * y
        basis[1] = np.float32(0.4886025119029199) * z
        basis[2] = np.float32(-0.4886025119029199) * x
    xx, yy, zz = x * x, y * y, z * z
    three, four, two = np.float32(3), np.float32(4), np.float32(2)
    if count >= 8:
        basis[3] = np.float32(1.0925484305920792) * x * y
        basis[4] = np.float32(-1.0925484305920792) * y * z
        basis[5] = np.float32(0.31539156525252005) * (two * zz - xx - yy)
        basis[6] = np.float32(-1.0925484305920792) * x * z
        basis[7] = np.float32(0.5462742152960396) * (xx - yy)
    if count >= 15:
        basis[8] = np.float32(-0.5900435899266435) * y * (three * xx - yy)
        basis[9] = np.float32(2.890611442640554) * x * y * z
        basis[10] = np.float32(-0.4570457994644658) * y * (four * zz - xx - yy)
        basis[11] = np.float32(0.3731763325901154) * z * (two * zz - three * (xx + yy))
        basis[12] = np.float32(-0.4570457994644658) * x * (four * zz - xx - yy)
        basis[13] = np.float32(1.445305721320277) * z * (xx - yy)
        basis[14] = np.float32(-0.5900435899266435) * x * (xx - three * yy)


@numba.njit(cache=True, error_model="numpy", fastmath=True)
def _raw_color(basis, sh_dc, sh_rest, i):
    """The colour before it is clamped."""
    red, green, blue = _HALF + _Y0 * sh_dc[i, 0], _HALF + _Y0 * sh_dc[i, 1], _HALF + _Y0 * sh_dc[i, 2]
    for k in range(len(basis)):
        red += basis[k] * sh_rest[i, k, 0]
        green += basis[k] * sh_rest[i, k, 1]
        blue += basis[k] * sh_rest[i, k, 2]
    return red, green, blue


@numba.njit(cache=True, parallel=True, error_model="numpy", fastmath=True)
def _colors(arguments, colors):
    means, sh_dc, sh_rest, position, nodes, rotations = arguments
    count = len(means)
    for chunk in numba.prange((count + _CHUNK - 1) // _CHUNK):
        basis = np.empty(sh_rest.shape[1], np.float32)
        for i in range(chunk * _CHUNK, min((chunk + 1) * _CHUNK, count)):
            if len(basis):
                _fill_basis(basis, means, i, position, nodes, rotations)
            color = _raw_color(basis, sh_dc, sh_rest, i)
            for channel in range(3):
                colors[i, channel] = max(color[channel], np.float32(0))


@numba.njit(cache=True, parallel=True, error_model="numpy", fastmath=True)
def _colors_backward(arguments, grad_colors, grad_dc, grad_rest):
    means, sh_dc, sh_rest, position, nodes, rotations = arguments
    count = len(means)
    for chunk in numba.prange((count + _CHUNK - 1) // _CHUNK):
        basis = np.empty(sh_rest.shape[1], np.float32)
        for i in range(chunk * _CHUNK, min((chunk + 1) * _CHUNK, count)):
            if grad_colors[i, 0] == 0 and grad_colors[i, 1] == 0 and grad_colors[i, 2] == 0:
                continue  # not seen: most of a drive's Gaussians are out of any one view
            if len(basis):
                _fill_basis(basis, means, i, position, nodes, rotations)
            color = _raw_color(basis, sh_dc, sh_rest, i)
            for channel in range(3):
                grad = grad_colors[i, channel] if color[channel] > 0 else np.float32(0)
                grad_dc[i, channel] = _Y0 * grad
                for k in range(len(basis)):
                    grad_rest[i, k, channel] = basis[k] * grad
