"""Large scenes with levels of detail: what the render thread draws drafts from."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float64, Int32, UInt16, UInt32
from numpy import ndarray

from instdrive_app.render.frame_keys import DRAFT_FACTOR
from instdrive_app.render.software.placed_splats import PlacedSplats
from instdrive_app.render.software.scene import SceneState
from instdrive_core.available_memory import measure_available_memory
from instdrive_core.maths.workspace import Workspace
from instdrive_core.rasterize.detail.cut import Cut, choose_cut, count_blocks_in_view
from instdrive_core.rasterize.detail.fit import LeafState, NodeState
from instdrive_core.rasterize.detail.gather import CutSplats, gather_cut
from instdrive_core.rasterize.detail.tree import build_detail_tree
from instdrive_core.rasterize.preview.colors import ColorSource
from instdrive_core.scene.camera import Camera

_FINEST, _COARSEST = 1.0, 5.0
"""Pixels of the draft: bounds on the standard deviation up to which a node stands for its splats. At whole resolution
the coarsest draft is nearer to the sharp frame than any at half resolution that is as quick."""
_NEAR_SHARP = 2.0
"""Pixels of a draft at half resolution: what is merged beyond that is easily seen to be coarse."""
_FIRST = _COARSEST, 1
"""Tolerance of the first draft, and how many times smaller than the view it is."""
_QUICK, _SLOWEST = 1 / 32, 1 / 20
"""Seconds: a draft is drawn as coarsely as the first asks for where it remains near the sharp frame; coarser than that
only where it would take longer than the second."""
_DEARER = 2.5
"""How many times longer a draft at whole resolution is taken to last than one at half, until both are known."""
_SPARE = 0.9
"""Share of its time that a draft at whole resolution must be expected to keep to."""
_WORTH_CULLING = 0.6
"""Share of blocks in view above which looking at all splats is faster than gathering those in view."""
_BYTES = 120
"""Memory that each splat needs while the tree is built; a third of it remains."""


@dataclass(frozen=True)
class _Fitted:
    """What the nodes were brought up to date with."""

    shown: Bool[ndarray, " n"]
    frames: Int32[ndarray, " n"]
    color_entries: UInt16[ndarray, " n"]
    instance_ids: UInt32[ndarray, " n"]
    table: Float64[ndarray, "f 18"]
    look_version: int


class MergedSplats:
    """A scene's splats and what they merge to, kept current with `PlacedSplats`. Only the render thread uses it.

    The tree is built by a thread of its own; `ready` is False until then, and stays so where memory is short.
    """

    def __init__(self, placed: PlacedSplats, wait_for_turn: Callable[[], object] = lambda: None) -> None:
        """Begin to build the tree, whose thread calls `wait_for_turn` every few milliseconds."""
        self._placed = placed
        self._nodes: NodeState | None = None
        self._fitted: _Fitted | None = None
        self.tolerance, self.factor = _FIRST
        """Pixels, and how many times smaller than the view a draft is."""
        self._given_up: float | None = None
        """Seconds of the draft at whole resolution after which the next one is drawn at half."""
        self._dearer = _DEARER
        self._thread = threading.Thread(
            target=self._build, args=(placed.state, wait_for_turn), name="detail", daemon=True
        )
        self._thread.start()

    @property
    def ready(self) -> bool:
        """Whether drafts can be drawn from it."""
        return self._nodes is not None

    def wait(self) -> None:
        """Wait until the tree is built, or cannot be."""
        self._thread.join()

    def choose(self, camera: Camera, near: float, workspace: Workspace) -> CutSplats:
        """Choose what a draft draws; the arrays are the workspace's. `near` is in metres."""
        nodes, leaves = self._update()
        return self._gather(choose_cut(nodes, camera, self.tolerance, near, workspace), nodes, leaves, workspace)

    def cull(self, camera: Camera, near: float, workspace: Workspace) -> CutSplats | None:
        """Find all splats that a view may show; None where they are so many that gathering them is no gain."""
        nodes, leaves = self._update()
        if count_blocks_in_view(nodes, camera, near) > _WORTH_CULLING * nodes.tree.block_count:
            return None
        cut = choose_cut(nodes, camera, 0.0, near, workspace)
        return self._gather(replace(cut, splats=np.sort(cut.splats)), nodes, leaves, workspace)

    def _gather(self, cut: Cut, nodes: NodeState, leaves: LeafState, workspace: Workspace) -> CutSplats:
        placed = self._placed
        alphas = np.ascontiguousarray(placed.state.color_values[:, 12], np.float32)
        found = gather_cut(cut, nodes, leaves, placed.quats, alphas, workspace)
        merged = slice(found.splat_count, None)
        placed.place_merged(found.frames[merged], found.means[merged], found.quats[merged], found.log_scales[merged])
        return found

    def build_sources(self, found: CutSplats, source: ColorSource) -> tuple[ColorSource, ColorSource]:
        """Build the colours of a cut's splats and of its nodes, given those of the scene."""
        assert self._nodes is not None, "the tree is built"
        tree, a = self._nodes.tree, found.splat_count
        parts = []
        harmonics = ((source.sh_dc, source.sh_rest), (tree.sh_dc, tree.sh_rest))
        for part, (sh_dc, sh_rest) in zip((slice(a), slice(a, None)), harmonics, strict=True):
            frames = found.frames[part] if len(source.frames) else source.frames
            entries, places = found.color_entries[part], found.sources[part]
            parts.append(ColorSource(sh_dc, sh_rest, frames, source.rotations, entries, source.matrices, places))
        return parts[0], parts[1]

    def adapt(self, seconds: float) -> None:
        """Draw coarser where the last draft took so many seconds that it was too slow, finer where time is left."""
        wanted = self._scale_tolerance(seconds / _QUICK)
        if self.factor == 1:
            if wanted > _COARSEST:
                self._given_up, self.factor, wanted = seconds, DRAFT_FACTOR, _NEAR_SHARP
        else:
            if self._given_up is not None:
                self._dearer, self._given_up = max(self._given_up / seconds, 1.0), None
            wanted = max(self._scale_tolerance(seconds / _SLOWEST), min(wanted, _NEAR_SHARP))
            if seconds * self._dearer < _SPARE * _QUICK:
                self.factor, wanted = 1, _COARSEST
        self.tolerance = min(max(wanted, _FINEST), _COARSEST)

    def _scale_tolerance(self, ratio: float) -> float:
        return self.tolerance * float(np.clip(ratio, 0.5, 1.6)) ** 0.5

    def _build(self, state: SceneState, wait_for_turn: Callable[[], object]) -> None:
        if measure_available_memory() < 2 * _BYTES * len(state.nodes):
            return
        self._nodes = NodeState(build_detail_tree(state.gaussians, state.instance_ids, state.nodes, wait_for_turn))

    def _update(self) -> tuple[NodeState, LeafState]:
        nodes, placed, before = self._nodes, self._placed, self._fitted
        assert nodes is not None, "the tree is built"
        ids, state = placed.state.instance_ids, placed.state
        leaves = LeafState(placed.means, placed.log_scales, placed.opacities, placed.frames, state.color_entries, ids)
        if before is not None and before.look_version == placed.look_version and before.instance_ids is ids:
            return nodes, leaves
        shown = placed.opacities > 0
        if before is None:
            blocks = np.arange(nodes.tree.block_count)
        else:
            changed = (shown != before.shown) | (placed.frames != before.frames)
            changed |= state.color_entries != before.color_entries
            changed |= ids != before.instance_ids
            blocks = nodes.find_blocks(changed | _find_shifted(before.table, placed))
        nodes.fit(blocks, leaves)
        entries = state.color_entries
        self._fitted = _Fitted(shown, placed.frames.copy(), entries, ids, placed.frame_table, placed.look_version)
        return nodes, leaves


def _find_shifted(before: Float64[ndarray, "f 18"], placed: PlacedSplats) -> Bool[ndarray, " n"]:
    """Find splats whose frame is elsewhere than it was."""
    table = placed.frame_table
    shifted = np.zeros(len(table), bool)
    shifted[: len(before)] = (table[: len(before)] != before).any(axis=1)
    if not shifted.any():
        return np.zeros(len(placed.frames), bool)
    return shifted[placed.frames]
