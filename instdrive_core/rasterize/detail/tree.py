"""Splats merged by fours, level by level: the tree whose nodes stand for what is small on the screen.

A node has the first two moments of its children (as Kerbl et al. 2024, "A Hierarchical 3D Gaussian Representation"):
weights are opacity times area, and its opacity lets through what theirs together do, seen from afar.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numba
import numpy as np
from jaxtyping import Float32, Int32, Int64, UInt16, UInt32
from numpy import ndarray

from instdrive_core.maths.activations import sigmoid
from instdrive_core.rasterize.detail.moments import add_covariance, split_covariance
from instdrive_core.rasterize.detail.order import order_splats
from instdrive_core.rasterize.kernels.layout import to_kernel_array
from instdrive_core.scene.gaussians import Gaussians

LEVELS = 5
"""Levels of nodes: one of the highest stands for 4⁵ splats."""
BLOCK = 4**LEVELS
_HARMONICS = 3
"""Coefficients above the constant that nodes keep: degree 1."""
_MOST_OPAQUE = 0.999
_PORTION = 2048
"""Nodes made in one go: some three milliseconds."""


@dataclass(frozen=True)
class DetailTree:
    """Merged splats of n splats; node j of level l (from 1) stands for `order[4ˡ j : 4ˡ (j + 1)]`."""

    order: Int32[ndarray, " n"]
    """Rows of the splats in the order in which they are merged."""
    starts: Int64[ndarray, " l"]
    """Where each level's nodes begin in the arrays below: level 1 at `starts[1]`; the last entry is m."""
    means: Float32[ndarray, "m 3"]
    quats: Float32[ndarray, "m 4"]
    log_scales: Float32[ndarray, "m 3"]
    opacities: Float32[ndarray, " m"]
    sh_dc: Float32[ndarray, "m 3"]
    sh_rest: Float32[ndarray, "m k 3"]

    @property
    def block_count(self) -> int:
        """How many nodes the highest level has."""
        return int(self.starts[-1] - self.starts[-2])


def build_detail_tree(
    gaussians: Gaussians,
    instance_ids: UInt32[ndarray, " n"],
    nodes: UInt16[ndarray, " n"],
    wait_for_turn: Callable[[], object] = lambda: None,
) -> DetailTree:
    """Merge splats where they are before any move; `nodes` says which rigid body each belongs to.

    Works on one core, so that a window beside it goes on: half a second for a million splats. `wait_for_turn` is called
    every few milliseconds and returns when nothing more urgent wants that core.
    """
    wait_for_turn()
    order = order_splats(gaussians.means, instance_ids, nodes)
    counts = [0, *(-(-len(order) // 4**level) for level in range(1, LEVELS + 1))]
    starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    total, kept = int(starts[-1]), min(_HARMONICS, gaussians.sh_rest.shape[1])
    tree = DetailTree(
        order,
        starts,
        np.empty((total, 3), np.float32),
        np.empty((total, 4), np.float32),
        np.empty((total, 3), np.float32),
        np.empty(total, np.float32),
        np.empty((total, 3), np.float32),
        np.empty((total, kept, 3), np.float32),
    )
    leaves = (gaussians.means, gaussians.quats, gaussians.log_scales, sigmoid(gaussians.opacity_logits))
    leaves = (*leaves, gaussians.sh_dc, gaussians.sh_rest)
    merged = (tree.means, tree.quats, tree.log_scales, tree.opacities, tree.sh_dc, tree.sh_rest)
    leaves = tuple(to_kernel_array(array) for array in leaves)
    for level in range(1, LEVELS + 1):
        for first in range(int(starts[level]), int(starts[level + 1]), _PORTION):
            wait_for_turn()
            _merge(order, starts, leaves, merged, level, first, min(first + _PORTION, int(starts[level + 1])))
    return tree


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _merge(order, starts, leaves, merged, level, first_node, end_node):
    """Make some nodes of a level, whose children are made."""
    rows, matrix, vectors = np.empty(4, np.int64), np.empty((3, 3)), np.empty((3, 3))
    covariance, mean = np.empty(6), np.empty(3)
    for node in range(first_node, end_node):
        place = 4 * (node - starts[level])
        if level == 1:
            end = min(place + 4, len(order))
            for k in range(place, end):
                rows[k - place] = order[k]
            _merge_one(leaves, rows[: end - place], merged, node, (mean, covariance, matrix, vectors))
        else:
            first, end = starts[level - 1] + place, min(starts[level - 1] + place + 4, starts[level])
            for k in range(first, end):
                rows[k - first] = k
            _merge_one(merged, rows[: end - first], merged, node, (mean, covariance, matrix, vectors))


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _merge_one(source, rows, merged, node, room):
    means, quats, log_scales, opacities, sh_dc, sh_rest = source
    mean, covariance, matrix, vectors = room
    mean[:] = 0
    covariance[:] = 0
    kept = merged[5].shape[1]
    merged[4][node] = 0
    merged[5][node] = 0
    total = 0.0
    for row in rows:
        total += _weigh(means, log_scales, opacities, row)
    for row in rows:
        share = _weigh(means, log_scales, opacities, row) / total if total > 0 else 0.0
        if not share > 0:
            continue
        for axis in range(3):
            mean[axis] += share * means[row, axis]
            merged[4][node, axis] += np.float32(share) * sh_dc[row, axis]
        for k in range(kept):
            for channel in range(3):
                merged[5][node, k, channel] += np.float32(share) * sh_rest[row, k, channel]
    for row in rows:
        share = _weigh(means, log_scales, opacities, row) / total if total > 0 else 0.0
        if not share > 0:
            continue
        add_covariance(quats[row], log_scales[row], share, covariance)
        x, y, z = means[row, 0] - mean[0], means[row, 1] - mean[1], means[row, 2] - mean[2]
        covariance[0] += share * x * x
        covariance[1] += share * x * y
        covariance[2] += share * x * z
        covariance[3] += share * y * y
        covariance[4] += share * y * z
        covariance[5] += share * z * z
    split_covariance(covariance, matrix, vectors, merged[1][node], merged[2][node])
    for axis in range(3):
        merged[0][node, axis] = mean[axis]
    merged[3][node] = min(total / max(_area(merged[2], node), 1e-30), _MOST_OPAQUE)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _area(log_scales, row):
    """Product of a splat's two longer standard deviations, m²."""
    a, b, c = float(log_scales[row, 0]), float(log_scales[row, 1]), float(log_scales[row, 2])
    return np.exp(a + b + c - min(a, b, c))


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _weigh(means, log_scales, opacities, row):
    """Opacity times area; 0 for what is not finite, which is never drawn."""
    weight = float(opacities[row]) * _area(log_scales, row)
    return weight if np.isfinite(weight + means[row, 0] + means[row, 1] + means[row, 2]) else 0.0
