"""The cut through the tree that a view needs: splats where they are large on the screen, merged ones elsewhere."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from jaxtyping import Float32, Int32
from numpy import ndarray

from instdrive_core.maths.workspace import Workspace
from instdrive_core.rasterize.detail.fit import NodeState
from instdrive_core.rasterize.detail.tree import BLOCK, LEVELS
from instdrive_core.rasterize.kernels.project import camera_to_row
from instdrive_core.rasterize.kernels.simd import prefetch
from instdrive_core.scene.camera import Camera, build_edge_normals

_MARGIN = 2.0
"""Pixels by which the low-pass filter lets even a point reach into the picture."""


@dataclass(frozen=True)
class Cut:
    """What is drawn instead of all splats; each splat in the view is there once, itself or in a node."""

    splats: Int32[ndarray, " a"]
    nodes: Int32[ndarray, " b"]


def choose_cut(state: NodeState, camera: Camera, tolerance: float, near: float, workspace: Workspace) -> Cut:
    """Choose nodes whose largest standard deviation is below `tolerance` (pixels), and splats where none is.

    Args:
        near: Metres; what lies nearer to the camera's plane is left out.
    """
    tree = state.tree
    blocks = tree.block_count
    listed = workspace.get_array("cut", (blocks, BLOCK), np.int32)
    counts = np.zeros((blocks, 2), np.int64)
    view = _build_view(camera, near)
    nodes = (state.spheres, state.rows, state.spreads)
    _choose(view, np.float32(tolerance), (tree.order, tree.starts), nodes, listed, counts)
    ends = np.cumsum(counts, axis=0)
    cut = Cut(np.empty(ends[-1, 0] if blocks else 0, np.int32), np.empty(ends[-1, 1] if blocks else 0, np.int32))
    _collect(listed, counts, ends - counts, cut.splats, cut.nodes)
    return cut


def count_blocks_in_view(state: NodeState, camera: Camera, near: float) -> int:
    """Count the blocks of 1,024 neighbours that may reach into the view; `near` as for `choose_cut`."""
    first = state.tree.starts[LEVELS]
    tops = (state.spheres[first:], state.rows[first:], state.spreads[first:])
    return _count(_build_view(camera, near), tops, state.tree.block_count)


def _build_view(camera: Camera, near: float) -> tuple[Float32[ndarray, " 22"], Float32[ndarray, "4 3"], np.float32]:
    edges = build_edge_normals(*camera.find_edge_slopes(_MARGIN)).astype(np.float32)
    return camera_to_row(camera), edges, np.float32(near)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"nsz", "arcp", "contract", "afn"})
def _judge(view, tolerance, sphere, row, spread):
    """0: out of the view or hidden; 1: draw the node; 2: look at what it stands for."""
    if row == -2:
        return 0
    row_of_view, planes, near = view
    x = row_of_view[0] * sphere[0] + row_of_view[1] * sphere[1] + row_of_view[2] * sphere[2] + row_of_view[9]
    y = row_of_view[3] * sphere[0] + row_of_view[4] * sphere[1] + row_of_view[5] * sphere[2] + row_of_view[10]
    z = row_of_view[6] * sphere[0] + row_of_view[7] * sphere[1] + row_of_view[8] * sphere[2] + row_of_view[11]
    radius = sphere[3]
    if z + radius < near:
        return 0
    for plane in range(4):
        if planes[plane, 0] * x + planes[plane, 1] * y + planes[plane, 2] * z < -radius:
            return 0
    if row < 0:
        return 2
    distance = np.sqrt(x * x + y * y + z * z) - radius
    if not distance > near:
        return 2
    return 1 if row_of_view[12] * spread < tolerance * distance else 2


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _count(view, tops, blocks):
    found = 0
    for block in range(blocks):
        if _judge(view, np.float32(0), tops[0][block], tops[1][block], tops[2][block]) != 0:
            found += 1
    return found


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def _choose(view, tolerance, order, nodes, listed, counts):
    """Splats fill each block's list from its start, nodes from its end.

    Level by level: what a node stands for is fetched as it is noted, long before it is looked at.
    """
    leaves, starts = order
    spheres, rows, spreads = nodes
    flat = spheres.reshape(-1)
    for block in numba.prange(len(listed)):
        asked, following = np.empty(BLOCK // 4, np.int64), np.empty(BLOCK // 4, np.int64)
        asked[0], count, splats, merged = starts[LEVELS] + block, 1, 0, 0
        for level in range(LEVELS, 0, -1):
            noted = 0
            for place in range(count):
                node = asked[place]
                verdict = _judge(view, tolerance, spheres[node], rows[node], spreads[node])
                first = 4 * (node - starts[level])
                if verdict == 1:
                    merged += 1
                    listed[block, BLOCK - merged] = node
                elif verdict == 2 and level == 1:
                    for k in range(first, min(first + 4, len(leaves))):
                        listed[block, splats] = leaves[k]
                        splats += 1
                elif verdict == 2:
                    first += starts[level - 1]
                    prefetch(flat, np.uint64(4 * first))
                    prefetch(rows, np.uint64(first))
                    prefetch(spreads, np.uint64(first))
                    for child in range(first, min(first + 4, starts[level])):
                        following[noted] = child
                        noted += 1
            asked, following, count = following, asked, noted
        counts[block, 0], counts[block, 1] = splats, merged


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def _collect(listed, counts, starts, splats, nodes):
    for block in numba.prange(len(listed)):
        for k in range(counts[block, 0]):
            splats[starts[block, 0] + k] = listed[block, k]
        for k in range(counts[block, 1]):
            nodes[starts[block, 1] + k] = listed[block, BLOCK - 1 - k]
