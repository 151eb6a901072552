"""Actors' Gaussians carried into the world on the CPU, with gradients to the Gaussians and to the poses.

A mean becomes R·m + t, a quaternion q(R) ⊗ q. The gradient by q(R) reaches R through the tangent of the rotations at
R: with ω the turn of R·exp[ω]×, dL/dω = ½ · vec(conj(q(R)) ⊗ dL/dq(R)), and of all nine-entry gradients with that
derivative along every turn, ½ R·[dL/dω]× is the smallest. The chain through any parametrisation of rotations is exact.
"""

from __future__ import annotations

import numba
import numpy as np
import torch
from jaxtyping import Float, Float32, Float64, Int64, UInt16
from numpy import ndarray
from torch import Tensor
from torch.autograd.function import once_differentiable

from instdrive_core.maths.rotations import multiply_quaternions, quaternion_from_matrix
from instdrive_core.rasterize.kernels.layout import to_kernel_array
from instdrive_core.training.backends.backend import Nodes, NodesOnDevice

_CHUNK = 1 << 10
_CONJUGATE = np.array([1, -1, -1, -1], np.float32)


def place_gaussians(
    means: Float[Tensor, "v 3"],
    quats: Float[Tensor, "v 4"],
    nodes: Nodes,
    rotations: Float[Tensor, "m 3 3"],
    shifts: Float[Tensor, "m 3"],
) -> tuple[Float[Tensor, "v 3"], Float[Tensor, "v 4"]]:
    """Means and quaternions in the world, given world_from_node of every node; node 0, the world, stays.

    Raises:
        ValueError: rows are not ordered by node.
    """
    assert not isinstance(nodes, NodesOnDevice), "kernels take arrays"
    starts = _starts_of_nodes(nodes, len(rotations))
    if starts[1] == len(nodes):
        return means, quats
    return _Place.apply(means, quats, rotations, shifts, starts)


def sum_rigid_gradient(
    means: Float[Tensor, "v 3"],
    quats: Float[Tensor, "v 4"],
    grad_means: Float[Tensor, "v 3"],
    grad_quats: Float[Tensor, "v 4"],
) -> tuple[Float64[ndarray, "3"], Float64[ndarray, "3"]]:
    """See `Backend.sum_rigid_gradient`."""
    sums = np.zeros((max(1, -(-len(means) // _CHUNK)), 16))
    _sum_chunks(_array(grad_means), _array(grad_quats), _array(means), _array(quats), sums)
    total = sums.sum(axis=0)
    products = total[:9].reshape(3, 3)
    crossed = (products.T - products)[[1, 2, 0], [2, 0, 1]]
    return total[9:12], crossed + 0.5 * total[13:]


def _starts_of_nodes(nodes: UInt16[ndarray, " v"], count: int) -> Int64[ndarray, " m+1"]:
    """The first row of each node, and the number of rows."""
    if np.any(nodes[1:] < nodes[:-1]):
        raise ValueError("rows must be ordered: background first, then actor by actor")
    if len(nodes) and nodes[-1] >= count:
        raise ValueError(f"a row lies in node {nodes[-1]}, there are {count}")
    return np.searchsorted(nodes, np.arange(count + 1, dtype=np.uint32)).astype(np.int64)


class _Place(torch.autograd.Function):
    @staticmethod
    def forward(ctx, means, quats, rotations, shifts, starts):
        ctx.save_for_backward(means, quats)  # so that torch notices changes in place
        ctx.matrices, ctx.starts = rotations.detach().numpy().astype(np.float64), starts
        ctx.turns = quaternion_from_matrix(ctx.matrices)
        poses = to_kernel_array(ctx.matrices), _array(shifts), to_kernel_array(ctx.turns)
        placed_means, placed_quats = _move_gaussians(_array(means), _array(quats), poses, starts)
        return torch.from_numpy(placed_means), torch.from_numpy(placed_quats)

    @staticmethod
    @once_differentiable
    def backward(ctx, grad_means, grad_quats):  # pyright: ignore[reportIncompatibleMethodOverride]
        means, quats = ctx.saved_tensors
        inputs, grads, starts = (_array(means), _array(quats)), (_array(grad_means), _array(grad_quats)), ctx.starts
        no_shifts = np.zeros((len(starts) - 1, 3), np.float32)
        inverse = to_kernel_array(ctx.matrices.transpose(0, 2, 1)), no_shifts, to_kernel_array(ctx.turns) * _CONJUGATE
        own_means, own_quats = _move_gaussians(*grads, inverse, starts)
        by_rotations = by_shifts = None
        if any(ctx.needs_input_grad[2:4]):
            sums = np.zeros((len(starts) - 1, 16), np.float64)
            _sum_nodes(*grads, *inputs, starts, sums)
            through_turns = _through_turns(ctx.matrices, ctx.turns, sums[:, 12:])
            by_rotations = torch.from_numpy((sums[:, :9].reshape(-1, 3, 3) + through_turns).astype(np.float32))
            by_shifts = torch.from_numpy(sums[:, 9:12].astype(np.float32))
        return torch.from_numpy(own_means), torch.from_numpy(own_quats), by_rotations, by_shifts, None


def _through_turns(
    matrices: Float64[ndarray, "m 3 3"], turns: Float64[ndarray, "m 4"], grad_turns: Float64[ndarray, "m 4"]
) -> Float64[ndarray, "m 3 3"]:
    """Gradients by the rotation matrices from those by their quaternions; see the top of the file."""
    x, y, z = np.moveaxis(0.5 * multiply_quaternions(turns * _CONJUGATE, grad_turns)[:, 1:], -1, 0)
    zero = np.zeros_like(x)
    crossed = np.stack([np.stack([zero, -z, y], -1), np.stack([z, zero, -x], -1), np.stack([-y, x, zero], -1)], axis=-2)
    return 0.5 * matrices @ crossed


def _move_gaussians(
    means: Float32[ndarray, "v 3"],
    quats: Float32[ndarray, "v 4"],
    poses: tuple[Float32[ndarray, "m 3 3"], Float32[ndarray, "m 3"], Float32[ndarray, "m 4"]],
    starts: Int64[ndarray, " m+1"],
) -> tuple[Float32[ndarray, "v 3"], Float32[ndarray, "v 4"]]:
    """Turn and shift rows by their node's matrix, shift and quaternion.

    On the way back this carries gradients: with transposed matrices, no shifts and conjugate quaternions.
    """
    moved_means, moved_quats = np.empty(means.shape, np.float32), np.empty(quats.shape, np.float32)
    _move(means, quats, *poses, starts, moved_means, moved_quats)
    return moved_means, moved_quats


def _array(tensor: Tensor) -> Float32[ndarray, "*n"]:
    return to_kernel_array(tensor.detach().numpy())


@numba.njit(fastmath={"nsz", "contract"}, error_model="numpy", cache=True)
def _multiply(turn, w, x, y, z):
    """Hamilton product of `turn` and the quaternion (w, x, y, z)."""
    a, b, c, d = turn[0], turn[1], turn[2], turn[3]
    return (
        a * w - b * x - c * y - d * z,
        b * w + a * x - d * y + c * z,
        c * w + d * x + a * y - b * z,
        d * w - c * x + b * y + a * z,
    )


@numba.njit(fastmath={"nsz", "contract"}, error_model="numpy", cache=True)
def _move_rows(means, quats, matrix, shift, turn, first, last, moved_means, moved_quats):
    for i in range(np.uint64(first), np.uint64(last)):
        x, y, z = means[i, 0], means[i, 1], means[i, 2]
        for axis in range(3):
            moved_means[i, axis] = matrix[axis, 0] * x + matrix[axis, 1] * y + matrix[axis, 2] * z + shift[axis]
        turned = _multiply(turn, quats[i, 0], quats[i, 1], quats[i, 2], quats[i, 3])
        for k in range(4):
            moved_quats[i, k] = turned[k]


@numba.njit(parallel=True, error_model="numpy", cache=True)
def _move(means, quats, matrices, shifts, turns, starts, moved_means, moved_quats):
    count = len(means)
    for chunk in numba.prange((count + _CHUNK - 1) // _CHUNK):
        first, last = chunk * _CHUNK, min((chunk + 1) * _CHUNK, count)
        still = min(max(starts[1], first), last)
        moved_means[first:still], moved_quats[first:still] = means[first:still], quats[first:still]
        node = np.searchsorted(starts, still, side="right") - 1
        while still < last:
            end = min(starts[node + 1], last)
            into = (moved_means, moved_quats)
            _move_rows(means, quats, matrices[node], shifts[node], turns[node], still, end, into[0], into[1])
            still, node = end, node + 1


@numba.njit(error_model="numpy", cache=True)
def _sum_node(grad_means, grad_quats, means, quats, first, last, sums):
    """Σ g·mᵀ (9), Σ g (3) and Σ h ⊗ conj(q) (4) over a node's rows, g and h the gradients of mean and quaternion."""
    for i in range(first, last):
        for axis in range(3):
            for k in range(3):
                sums[3 * axis + k] += grad_means[i, axis] * means[i, k]
            sums[9 + axis] += grad_means[i, axis]
        by_turn = _multiply(grad_quats[i], quats[i, 0], -quats[i, 1], -quats[i, 2], -quats[i, 3])
        for k in range(4):
            sums[12 + k] += by_turn[k]


@numba.njit(parallel=True, error_model="numpy", cache=True)
def _sum_chunks(grad_means, grad_quats, means, quats, sums):
    """Sums of `_sum_node` by chunks of rows: the same bits whatever the number of threads."""
    for chunk in numba.prange(len(sums)):
        last = min((chunk + 1) * _CHUNK, len(means))
        _sum_node(grad_means, grad_quats, means, quats, chunk * _CHUNK, last, sums[chunk])


@numba.njit(parallel=True, error_model="numpy", cache=True)
def _sum_nodes(grad_means, grad_quats, means, quats, starts, sums):
    """A node's rows are added by one thread, in order."""
    for node in numba.prange(1, len(starts) - 1):
        _sum_node(grad_means, grad_quats, means, quats, starts[node], starts[node + 1], sums[node])
