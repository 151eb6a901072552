"""What nodes of the tree are at present: where they stand, how far they reach, and whether they may be drawn."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from jaxtyping import Bool, Float32, Int32, Int64, UInt16, UInt32
from numpy import ndarray

from instdrive_core.rasterize.detail.tree import BLOCK, DetailTree

REACH = np.float32(4.4)
"""Standard deviations that a splat reaches: 3.33 until its alpha is 1/255, times 1.3, because beside the picture its
shape is projected as if at most 15 % of the picture's size away from it."""
_MIXED = np.int32(-1)
_HIDDEN = np.int32(-2)


@dataclass(frozen=True)
class LeafState:
    """The n splats as they are shown now."""

    means: Float32[ndarray, "n 3"]
    """In the world, metres."""
    log_scales: Float32[ndarray, "n 3"]
    opacities: Float32[ndarray, " n"]
    """0 for what is not drawn."""
    frames: Int32[ndarray, " n"]
    """Which frame each splat moves with."""
    color_entries: UInt16[ndarray, " n"]
    instance_ids: UInt32[ndarray, " n"]


class NodeState:
    """The tree's m nodes as they are shown now; arrays are overwritten by `fit`."""

    def __init__(self, tree: DetailTree) -> None:
        count = len(tree.means)
        self.tree = tree
        self.spheres = np.zeros((count, 4), np.float32)
        """Centre in the world and radius (metres) of a sphere around all that the node stands for."""
        self.rows = np.full(count, _MIXED, np.int32)
        """A splat that shares frame, colour and instance with all others of the node; -1 where they differ, -2 where
        none is drawn."""
        self.spreads = np.exp(tree.log_scales.max(axis=1))
        """Largest standard deviation of each node before any move, metres."""
        self._place = np.empty(len(tree.order), np.int32)
        self._place[tree.order] = np.arange(len(tree.order), dtype=np.int32)

    def find_blocks(self, changed: Bool[ndarray, " n"]) -> Int64[ndarray, " b"]:
        """Find the blocks that hold some of the splats."""
        touched = np.zeros(self.tree.block_count, bool)
        touched[self._place[changed] // BLOCK] = True
        return np.flatnonzero(touched)

    def fit(self, blocks: Int64[ndarray, " b"], leaves: LeafState) -> None:
        """Bring the nodes of some blocks up to date with their splats."""
        order = (self.tree.order, self.tree.starts)
        places = (leaves.means, leaves.log_scales, leaves.opacities)
        _fit(blocks, order, places, (leaves.frames, leaves.color_entries, leaves.instance_ids), self.spheres, self.rows)


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def _fit(blocks, order, places, kinds, spheres, rows):
    leaves, starts = order
    top = len(starts) - 2
    for at in numba.prange(len(blocks)):
        for level in range(1, top + 1):
            span = 4 ** (top - level)
            first = starts[level] + blocks[at] * span
            for node in range(first, min(first + span, starts[level + 1])):
                child = 4 * (node - starts[level])
                if level == 1:
                    _fit_leaves(leaves, child, places, kinds, spheres, rows, node)
                else:
                    end = min(starts[level - 1] + child + 4, starts[level])
                    _fit_nodes(starts[level - 1] + child, end, kinds, spheres, rows, node)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _same(kinds, a, b):
    return kinds[0][a] == kinds[0][b] and kinds[1][a] == kinds[1][b] and kinds[2][a] == kinds[2][b]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _fit_leaves(leaves, first, places, kinds, spheres, rows, node):
    means, log_scales, opacities = places
    end = min(first + 4, len(leaves))
    x, y, z, shown = np.float32(0), np.float32(0), np.float32(0), 0
    kind = _HIDDEN
    for k in range(first, end):
        row = leaves[k]
        if not (opacities[row] > 0 and np.isfinite(means[row, 0] + means[row, 1] + means[row, 2])):
            continue
        x, y, z, shown = x + means[row, 0], y + means[row, 1], z + means[row, 2], shown + 1
        if kind == _HIDDEN:
            kind = row
        elif kind >= 0 and not _same(kinds, kind, row):
            kind = _MIXED
    rows[node] = kind if shown in (0, end - first) else _MIXED
    if not shown:
        spheres[node, :] = 0
        return
    x, y, z, radius = x / shown, y / shown, z / shown, np.float32(0)
    for k in range(first, end):
        row = leaves[k]
        if not (opacities[row] > 0 and np.isfinite(means[row, 0] + means[row, 1] + means[row, 2])):
            continue
        dx, dy, dz = means[row, 0] - x, means[row, 1] - y, means[row, 2] - z
        reach = REACH * np.exp(max(log_scales[row, 0], log_scales[row, 1], log_scales[row, 2]))
        radius = max(radius, np.sqrt(dx * dx + dy * dy + dz * dz) + reach)
    spheres[node, 0], spheres[node, 1], spheres[node, 2], spheres[node, 3] = x, y, z, radius


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _fit_nodes(first, end, kinds, spheres, rows, node):
    x, y, z, shown = np.float32(0), np.float32(0), np.float32(0), 0
    kind = _HIDDEN
    for child in range(first, end):
        if rows[child] == _HIDDEN:
            continue
        x, y, z, shown = x + spheres[child, 0], y + spheres[child, 1], z + spheres[child, 2], shown + 1
        if kind == _HIDDEN:
            kind = rows[child]
        elif kind >= 0 and (rows[child] < 0 or not _same(kinds, kind, rows[child])):
            kind = _MIXED
    rows[node] = kind if shown in (0, end - first) else _MIXED
    if not shown:
        spheres[node, :] = 0
        return
    x, y, z, radius = x / shown, y / shown, z / shown, np.float32(0)
    for child in range(first, end):
        if rows[child] == _HIDDEN:
            continue
        dx, dy, dz = spheres[child, 0] - x, spheres[child, 1] - y, spheres[child, 2] - z
        radius = max(radius, np.sqrt(dx * dx + dy * dy + dz * dz) + spheres[child, 3])
    spheres[node, 0], spheres[node, 1], spheres[node, 2], spheres[node, 3] = x, y, z, radius
