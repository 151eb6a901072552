"""Rows of a scene as an edited document shows them at one moment: where in the world, how large, how opaque.

Written for whoever keeps such arrays: each function fills a range of rows in place, in one pass over memory and
without holding Python's lock, so that an edit costs what it touched. They are serial: views and renderers run them
beside each other, which not every threading layer of parallel kernels survives.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from jaxtyping import Float32, Float64, Int, UInt8, UInt16
from numpy import ndarray

from instdrive_core.maths.rotations import multiply_quaternions, normalize_quaternions, quaternion_from_matrix
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.palette import ColorPalette
from instdrive_core.scene.splat_array import create_read_only_view
from instdrive_core.scene.transforms import TransformPalette


@dataclass(frozen=True)
class RowFrames:
    """Transforms of a row into the world: its entry of the transform palette, then its node's pose."""

    entries: Float64[ndarray, "p 3 4"]
    """[s R | t] of every palette entry."""
    nodes: Float64[ndarray, "m 3 4"]
    """world_from_node."""

    @classmethod
    def copy_from(cls, transforms: TransformPalette, poses: Float64[ndarray, "m 4 4"]) -> RowFrames:
        """Copy the transforms, so that later edits do not change them."""
        return cls(transforms.matrices.copy(), np.ascontiguousarray(poses[:, :3]))


def write_world_means(
    means: Float32[ndarray, "n 3"],
    entry_of_row: UInt16[ndarray, " n"],
    node_of_row: UInt16[ndarray, " n"],
    frames: RowFrames,
    rows: tuple[int, int],
    world_means: Float32[ndarray, "n 3"],
) -> None:
    """Write the world positions (metres) of rows ``start … stop - 1`` into `world_means`."""
    rigid = _input(frames.entries), _input(frames.nodes)
    _place_means(_input(means), _input(entry_of_row), _input(node_of_row), *rigid, *rows, world_means)


def write_largest_log_scales(
    log_scales: Float32[ndarray, "n 3"],
    entry_of_row: UInt16[ndarray, " n"],
    frames: RowFrames,
    rows: tuple[int, int],
    log_sizes: Float32[ndarray, "n 1"],
) -> None:
    """Write the logarithm of each row's longest axis (metres), its move's scale included, into `log_sizes`."""
    growth = np.log(np.linalg.norm(frames.entries[:, :, 0], axis=1)).astype(np.float32)
    _largest_log_scales(_input(log_scales), _input(entry_of_row), _input(growth), *rows, log_sizes)


def write_shown_opacities(
    logits: Float32[ndarray, " n"],
    colors: ColorPalette,
    flags: UInt8[ndarray, " n"],
    hidden_flags: int,
    node_of_row: UInt16[ndarray, " n"],
    present: UInt8[ndarray, " m"],
    rows: tuple[int, int],
    opacities: Float32[ndarray, " n"],
) -> None:
    """Write the opacities that are shown into `opacities`: recoloured, and 0 where a row has any of `hidden_flags` or
    its node is not `present`."""
    recoloring = _input(colors.indices), _input(colors.alphas)
    visibility = _input(flags), _input(node_of_row), _input(present), np.uint8(hidden_flags)
    _shown_opacities(_input(logits), *recoloring, *visibility, *rows, opacities)


def compute_world_shapes(
    gaussians: Gaussians,
    entry_of_row: UInt16[ndarray, " n"],
    node_of_row: UInt16[ndarray, " n"],
    frames: RowFrames,
    rows: Int[ndarray, " k"],
) -> tuple[Float32[ndarray, "k 4"], Float32[ndarray, "k 3"]]:
    """Compute quaternions in the world and log scales (of metres) of some rows, moves included."""
    quats, log_scales = gaussians.quats[rows], gaussians.log_scales[rows]
    pairs = (entry_of_row[rows].astype(np.int64) << 16) | node_of_row[rows]
    moved = np.flatnonzero(pairs)
    if not len(moved):
        return quats, log_scales
    distinct, place = np.unique(pairs[moved], return_inverse=True)
    linear = frames.entries[distinct >> 16, :, :3]
    scales = np.linalg.norm(linear[:, :, 0], axis=1)
    turns = multiply_quaternions(
        quaternion_from_matrix(frames.nodes[distinct & 0xFFFF, :, :3]),
        quaternion_from_matrix(linear / scales[:, None, None]),
    )
    quats[moved] = multiply_quaternions(turns[place], normalize_quaternions(quats[moved]))
    log_scales[moved] += np.log(scales)[place, None].astype(np.float32)
    return quats, log_scales


def _input(array: ndarray) -> ndarray:
    """Bring an array into the layout that the kernels are compiled for; a view where it has it already."""
    return create_read_only_view(np.ascontiguousarray(array))


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _place_means(means, entry_of_row, node_of_row, entries, nodes, start, stop, world_means):
    for i in range(start, stop):
        entry, node = entry_of_row[i], node_of_row[i]
        if entry == 0 and node == 0:
            for axis in range(3):
                world_means[i, axis] = means[i, axis]
            continue
        x, y, z = np.float64(means[i, 0]), np.float64(means[i, 1]), np.float64(means[i, 2])
        if entry:
            a = entries[entry]
            x, y, z = (
                a[0, 0] * x + a[0, 1] * y + a[0, 2] * z + a[0, 3],
                a[1, 0] * x + a[1, 1] * y + a[1, 2] * z + a[1, 3],
                a[2, 0] * x + a[2, 1] * y + a[2, 2] * z + a[2, 3],
            )
        b = nodes[node]
        for axis in range(3):
            world_means[i, axis] = b[axis, 0] * x + b[axis, 1] * y + b[axis, 2] * z + b[axis, 3]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _largest_log_scales(log_scales, entry_of_row, growth, start, stop, log_sizes):
    for i in range(start, stop):
        largest = max(log_scales[i, 0], max(log_scales[i, 1], log_scales[i, 2]))
        log_sizes[i, 0] = largest + growth[entry_of_row[i]]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _shown_opacities(logits, entry_of_row, alphas, flags, node_of_row, present, hidden, start, stop, opacities):
    half, one = np.float32(0.5), np.float32(1)
    for i in range(start, stop):
        if flags[i] & hidden or not present[node_of_row[i]]:
            opacities[i] = 0
        else:
            opacities[i] = half * (one + np.tanh(half * logits[i])) * alphas[entry_of_row[i]]
