"""The splats and nodes of a cut side by side, as the rasterizer takes them."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from jaxtyping import Float32, Int32, UInt16
from numpy import ndarray

from instdrive_core.maths.workspace import Workspace
from instdrive_core.rasterize.detail.cut import Cut
from instdrive_core.rasterize.detail.fit import LeafState, NodeState
from instdrive_core.rasterize.kernels.simd import prefetch

_AHEAD = 16
"""So many places ahead memory is fetched."""


@dataclass(frozen=True)
class CutSplats:
    """The c = a + b Gaussians of a cut: a splats, then b nodes. Arrays are the workspace's, but for the last two."""

    means: Float32[ndarray, "c 3"]
    """Metres; in the world, but for nodes of frames other than the first, which are in those."""
    quats: Float32[ndarray, "c 4"]
    log_scales: Float32[ndarray, "c 3"]
    opacities: Float32[ndarray, " c"]
    frames: Int32[ndarray, " c"]
    color_entries: UInt16[ndarray, " c"]
    rows: Int32[ndarray, " c"]
    """A splat that each stands for."""
    sources: Int32[ndarray, " c"]
    """Row of each in the arrays that it comes from: the scene's, or the tree's."""
    splat_count: int
    """a."""


def gather_cut(
    cut: Cut,
    state: NodeState,
    leaves: LeafState,
    quats: Float32[ndarray, "n 4"],
    alphas: Float32[ndarray, " p"],
    workspace: Workspace,
) -> CutSplats:
    """Gather what is drawn.

    Args:
        quats: of the splats, in the world.
        alphas: factor on the opacity of each entry of the colour palette.
    """
    splats, count = len(cut.splats), len(cut.splats) + len(cut.nodes)
    found = CutSplats(
        workspace.get_array("cut means", (count, 3)),
        workspace.get_array("cut quats", (count, 4)),
        workspace.get_array("cut log scales", (count, 3)),
        workspace.get_array("cut opacities", (count,)),
        workspace.get_array("cut frames", (count,), np.int32),
        workspace.get_array("cut entries", (count,), np.uint16),
        np.empty(count, np.int32),
        np.concatenate([cut.splats, cut.nodes]),
        splats,
    )
    tree, kinds = state.tree, (leaves.frames, leaves.color_entries)
    written = (found.means, found.quats, found.log_scales, found.opacities)
    marks = (found.frames, found.color_entries, found.rows)
    shown = (leaves.means, quats, leaves.log_scales, leaves.opacities)
    merged = (tree.means, tree.quats, tree.log_scales, tree.opacities)
    _gather(cut.splats, cut.splats, 0, shown, kinds, written, marks)
    _gather(cut.nodes, state.rows[cut.nodes], splats, merged, kinds, written, marks)
    _fade(found.opacities[splats:], found.color_entries[splats:], alphas)
    return found


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def _gather(sources, rows, start, arrays, kinds, written, marks):
    flat = (arrays[0].reshape(-1), arrays[1].reshape(-1), arrays[2].reshape(-1))
    for k in numba.prange(len(sources)):
        ahead = np.uint64(sources[min(k + _AHEAD, len(sources) - 1)])
        prefetch(flat[0], ahead * np.uint64(3))
        prefetch(flat[1], ahead * np.uint64(4))
        prefetch(flat[2], ahead * np.uint64(3))
        prefetch(arrays[3], ahead)
        ahead = np.uint64(rows[min(k + _AHEAD, len(sources) - 1)])
        prefetch(kinds[0], ahead)
        prefetch(kinds[1], ahead)
        source, row, at = sources[k], rows[k], start + k
        for axis in range(3):
            written[0][at, axis] = arrays[0][source, axis]
            written[2][at, axis] = arrays[2][source, axis]
        for part in range(4):
            written[1][at, part] = arrays[1][source, part]
        written[3][at] = arrays[3][source]
        marks[0][at], marks[1][at], marks[2][at] = kinds[0][row], kinds[1][row], row


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _fade(opacities, entries, alphas):
    for k in range(len(opacities)):
        opacities[k] *= alphas[entries[k]]
