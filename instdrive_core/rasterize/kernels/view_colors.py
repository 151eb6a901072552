"""Colours of Gaussians seen from a place: spherical harmonics evaluated in parallel, and the gradient of that.

The formulas are those of `maths.spherical_harmonics`; a test holds the two together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from jaxtyping import Float, Float32, UInt16
from numpy import ndarray

from instdrive_core.maths.spherical_harmonics import Y0
from instdrive_core.rasterize.kernels.layout import to_kernel_array
from instdrive_core.scene.scene import extract_node_rotations

_CHUNK = 1 << 8
"""Rows whose directions and basis values a thread computes at once: attributes are interleaved, these lie in columns,
so that the loops over them vectorise."""
_Y0 = np.float32(Y0)
_HALF = np.float32(0.5)


@dataclass(frozen=True)
class HarmonicsView:
    """A view in which harmonics are evaluated: Gaussians, a camera, and the nodes whose frames turn them."""

    means: Float32[ndarray, "n 3"]
    """Means in the world, actors placed."""
    position: Float32[ndarray, "3"]
    """The camera's."""
    nodes: UInt16[ndarray, " n"]
    """Node of each row; empty where none turns."""
    rotations: Float32[ndarray, "m 3 3"]
    """world_from_node; the identity for node 0."""

    def arguments(self) -> tuple[ndarray, ...]:
        """Arrays in the order in which the kernels take them."""
        return self.means, self.position, self.nodes, self.rotations


def build_harmonics_view(
    means: Float[ndarray, "n 3"],
    camera_position: Float[ndarray, "3"],
    nodes: UInt16[ndarray, " n"] | None = None,
    poses: Float[ndarray, "m 4 4"] | None = None,
) -> HarmonicsView:
    """Build the view of Gaussians from a camera; `compute_colors` describes the arguments."""
    if nodes is None or poses is None or len(poses) < 2 or not nodes.any():
        nodes, rotations = np.zeros(0, np.uint16), np.eye(3)[None]
    else:
        rotations = extract_node_rotations(np.asarray(poses, np.float64))
        rotations[0] = np.eye(3)
    row_nodes = np.require(nodes, np.uint16, ["C", "W"])
    return HarmonicsView(
        to_kernel_array(means), to_kernel_array(camera_position), row_nodes, to_kernel_array(rotations)
    )


def compute_colors(
    means: Float[ndarray, "n 3"],
    sh_dc: Float[ndarray, "n 3"],
    sh_rest: Float[ndarray, "n k 3"],
    camera_position: Float[ndarray, "3"],
    nodes: UInt16[ndarray, " n"] | None = None,
    poses: Float[ndarray, "m 4 4"] | None = None,
) -> Float32[ndarray, "n 3"]:
    """Compute the RGB (≥ 0) of each Gaussian along the direction from the camera to it.

    Args:
        means: in the world, actors placed.
        nodes: node of each row, 0 = background; with `poses`, an actor's harmonics turn with it: they are looked up
            along the direction in the actor's frame.
        poses: world_from_node, as `Scene.find_node_poses` gives them.
    """
    return compute_colors_in_view(build_harmonics_view(means, camera_position, nodes, poses), sh_dc, sh_rest)


def compute_colors_in_view(
    view: HarmonicsView, sh_dc: Float[ndarray, "n 3"], sh_rest: Float[ndarray, "n k 3"]
) -> Float32[ndarray, "n 3"]:
    """Compute colours as `compute_colors` does, for a view that is used twice."""
    colors = np.empty((len(view.means), 3), np.float32)
    _colors(view.arguments(), to_kernel_array(sh_dc), to_kernel_array(sh_rest), colors)
    return colors


def compute_colors_backward(
    view: HarmonicsView, rest_count: int, colors: Float32[ndarray, "n 3"], grad_colors: Float[ndarray, "n 3"]
) -> tuple[Float32[ndarray, "n 3"], Float32[ndarray, "n k 3"]]:
    """Compute gradients with respect to `sh_dc` and `sh_rest`, given the colours and their gradient.

    None flows through the direction into the means: it is small beside that of the projection, and 3DGS trains
    as well without it. Channels clamped at 0 send none back.

    Args:
        rest_count: k, the coefficients above the constant.
    """
    grad_dc = np.empty((len(colors), 3), np.float32)
    grad_rest = np.empty((len(colors), rest_count, 3), np.float32)
    _colors_backward(view.arguments(), to_kernel_array(colors), to_kernel_array(grad_colors), grad_dc, grad_rest)
    return grad_dc, grad_rest


@numba.njit(cache=True, error_model="numpy")
def _has_moved_row(first, last, nodes):
    if len(nodes):
        for i in range(np.uint64(first), np.uint64(last)):
            if nodes[i]:
                return True
    return False


@numba.njit(cache=True, error_model="numpy", fastmath=True)
def _fill_directions(first, last, view, directions):
    """Unit directions from the camera to some Gaussians, each in its node's own frame; x, y and z in a row each."""
    means, position, nodes, rotations = view
    for i in range(np.uint64(first), np.uint64(last)):
        at = i - np.uint64(first)
        for axis in range(3):
            directions[axis, at] = means[i, axis] - position[axis]
    if _has_moved_row(first, last, nodes):
        for i in range(np.uint64(first), np.uint64(last)):
            node, at = np.uint64(nodes[i]), i - np.uint64(first)
            x, y, z = directions[0, at], directions[1, at], directions[2, at]
            for axis in range(3):
                directions[axis, at] = (
                    rotations[node, 0, axis] * x + rotations[node, 1, axis] * y + rotations[node, 2, axis] * z
                )
    for at in range(np.uint64(last - first)):
        x, y, z = directions[0, at], directions[1, at], directions[2, at]
        scale = np.float32(1) / np.sqrt(max(x * x + y * y + z * z, np.float32(1e-12)))
        directions[0, at], directions[1, at], directions[2, at] = x * scale, y * scale, z * scale


@numba.njit(cache=True, error_model="numpy", fastmath=True)
def fill_basis(count, directions, basis):
    """Fill in the basis values above the constant, a row each, for `count` directions."""
    three, four, two = np.float32(3), np.float32(4), np.float32(2)
    for i in range(np.uint64(count)):
        x, y, z = directions[0, i], directions[1, i], directions[2, i]
        basis[0, i] = np.float32(-0.4886025119029199) * y
        basis[1, i] = np.float32(0.4886025119029199) * z
        basis[2, i] = np.float32(-0.4886025119029199) * x
    if len(basis) < 8:
        return
    for i in range(np.uint64(count)):
        x, y, z = directions[0, i], directions[1, i], directions[2, i]
        basis[3, i] = np.float32(1.0925484305920792) * x * y
        basis[4, i] = np.float32(-1.0925484305920792) * y * z
        basis[5, i] = np.float32(0.31539156525252005) * (two * z * z - x * x - y * y)
        basis[6, i] = np.float32(-1.0925484305920792) * x * z
        basis[7, i] = np.float32(0.5462742152960396) * (x * x - y * y)
    if len(basis) < 15:
        return
    for i in range(np.uint64(count)):
        x, y, z = directions[0, i], directions[1, i], directions[2, i]
        xx, yy, zz = x * x, y * y, z * z
        basis[8, i] = np.float32(-0.5900435899266435) * y * (three * xx - yy)
        basis[9, i] = np.float32(2.890611442640554) * x * y * z
        basis[10, i] = np.float32(-0.4570457994644658) * y * (four * zz - xx - yy)
        basis[11, i] = np.float32(0.3731763325901154) * z * (two * zz - three * (xx + yy))
        basis[12, i] = np.float32(-0.4570457994644658) * x * (four * zz - xx - yy)
        basis[13, i] = np.float32(1.445305721320277) * z * (xx - yy)
        basis[14, i] = np.float32(-0.5900435899266435) * x * (xx - three * yy)


@numba.njit(cache=True, error_model="numpy", fastmath=True)
def _write_colors(first, last, sh_dc, sh_rest, basis, colors):
    zero = np.float32(0)
    for i in range(np.uint64(first), np.uint64(last)):
        at = i - np.uint64(first)
        red, green, blue = _HALF + _Y0 * sh_dc[i, 0], _HALF + _Y0 * sh_dc[i, 1], _HALF + _Y0 * sh_dc[i, 2]
        for k in range(np.uint64(len(basis))):
            value = basis[k, at]
            red += value * sh_rest[i, k, 0]
            green += value * sh_rest[i, k, 1]
            blue += value * sh_rest[i, k, 2]
        colors[i, 0], colors[i, 1], colors[i, 2] = max(red, zero), max(green, zero), max(blue, zero)


@numba.njit(cache=True, error_model="numpy", fastmath=True)
def _write_gradients(first, last, colors, grad_colors, basis, grad_dc, grad_rest):
    zero = np.float32(0)
    for i in range(np.uint64(first), np.uint64(last)):
        at = i - np.uint64(first)
        red = grad_colors[i, 0] if colors[i, 0] > zero else zero
        green = grad_colors[i, 1] if colors[i, 1] > zero else zero
        blue = grad_colors[i, 2] if colors[i, 2] > zero else zero
        grad_dc[i, 0], grad_dc[i, 1], grad_dc[i, 2] = _Y0 * red, _Y0 * green, _Y0 * blue
        for k in range(np.uint64(len(basis))):
            value = basis[k, at]
            grad_rest[i, k, 0], grad_rest[i, k, 1], grad_rest[i, k, 2] = value * red, value * green, value * blue


@numba.njit(cache=True, parallel=True, error_model="numpy", fastmath=True)
def _colors(view, sh_dc, sh_rest, colors):
    count = len(colors)
    for chunk in numba.prange((count + _CHUNK - 1) // _CHUNK):
        first, last = chunk * _CHUNK, min((chunk + 1) * _CHUNK, count)
        directions, basis = np.empty((3, _CHUNK), np.float32), np.empty((sh_rest.shape[1], _CHUNK), np.float32)
        if len(basis):
            _fill_directions(first, last, view, directions)
            fill_basis(last - first, directions, basis)
        _write_colors(first, last, sh_dc, sh_rest, basis, colors)


@numba.njit(cache=True, parallel=True, error_model="numpy", fastmath=True)
def _colors_backward(view, colors, grad_colors, grad_dc, grad_rest):
    count = len(colors)
    for chunk in numba.prange((count + _CHUNK - 1) // _CHUNK):
        first, last = chunk * _CHUNK, min((chunk + 1) * _CHUNK, count)
        directions, basis = np.empty((3, _CHUNK), np.float32), np.empty((grad_rest.shape[1], _CHUNK), np.float32)
        if len(basis):
            _fill_directions(first, last, view, directions)
            fill_basis(last - first, directions, basis)
        _write_gradients(first, last, colors, grad_colors, basis, grad_dc, grad_rest)
