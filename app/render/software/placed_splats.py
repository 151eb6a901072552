"""The splats of a scene's state at a time, placed in the world and kept current on the render thread."""

from __future__ import annotations

import numba
import numpy as np
from jaxtyping import Float32, Float64, Int32, Int64
from numpy import ndarray

from instdrive_app.render.software.scene import SceneState
from instdrive_core.maths.activations import sigmoid
from instdrive_core.maths.rotations import quaternion_from_matrix
from instdrive_core.rasterize.kernels.layout import to_kernel_array
from instdrive_core.scene.camera import PhotoLag
from instdrive_core.scene.scene import extract_node_rotations
from instdrive_core.scene.selection import Flag
from instdrive_core.scene.track import find_node_poses

NOT_DRAWN = int(Flag.HIDDEN | Flag.DELETED)

# Columns of a frame: rotation, offset (metres), rotation as a quaternion, scale, whether it exists.
_OFFSET, _QUAT, _SCALE, _EXISTS, _FRAME_FLOATS = 9, 12, 16, 17, 18

Moment = tuple[float, PhotoLag | None]
"""Seconds, and the lag of the photo that is looked through."""


class PlacedSplats:
    """Arrays of n rows that follow `update`; only the render thread uses them.

    Each row names a frame, which is a pair of node and move; frame 0 is the background that was never moved.
    """

    def __init__(self, state: SceneState, time: float, lag: PhotoLag | None = None) -> None:
        """Place all splats, in tens of milliseconds for a million; `update` touches only what has changed."""
        gaussians = state.gaussians
        self._stored = tuple(to_kernel_array(a) for a in (gaussians.means, gaussians.quats, gaussians.log_scales))
        self.means, self.quats, self.log_scales = self._stored
        """World positions (n, 3), metres; rotations wxyz (n, 4); log scales (n, 3). The scene's own arrays until
        something moves."""
        self.opacities = np.empty(len(gaussians), np.float32)
        """Opacities (n,) after recolouring; 0 for what is not drawn."""
        self.areas = np.empty(len(gaussians), np.float32)
        """Product of each splat's two longer standard deviations (n,), m²."""
        self.frames = np.zeros(len(gaussians), np.int32)
        self.look_version = 0
        """Rises when the splats would look different: their places, colours, or which are shown."""
        self._base_opacities = to_kernel_array(sigmoid(gaussians.opacity_logits))
        self._frame_of: dict[tuple[int, int], int] = {(0, 0): 0}
        self._table = _build_frame_table(list(self._frame_of), state, (time, lag))
        self._place(np.arange(len(gaussians)))
        moved = np.flatnonzero((state.nodes > 0) | (state.move_entries > 0))
        self._move(moved, state, (time, lag))
        self._set_opacities(state)
        self.state, self._moment = state, (time, lag)

    @property
    def rotations(self) -> Float32[ndarray, "f 3 3"]:
        """World from frame: a splat evaluates its harmonics in its frame."""
        return self._table[:, :_OFFSET].reshape(-1, 3, 3).astype(np.float32)

    @property
    def turned(self) -> bool:
        """Whether there are frames other than the first."""
        return len(self._table) > 1

    @property
    def frame_table(self) -> Float64[ndarray, "f 18"]:
        """Where each frame is; another array as soon as one has changed."""
        return self._table

    def name(self, rows: Int32[ndarray, " k"]) -> Int32[ndarray, " k"]:
        """Name what pixels of some rows stand for: the row, or -1 for those of shadows."""
        names = self.state.names
        return names[rows] if len(names) else rows

    def place_merged(
        self,
        frames: Int32[ndarray, " k"],
        means: Float32[ndarray, "k 3"],
        quats: Float32[ndarray, "k 4"],
        log_scales: Float32[ndarray, "k 3"],
    ) -> None:
        """Place Gaussians that are not rows of the scene, in place: out of their frames into the world."""
        rows, arrays = np.flatnonzero(frames), (means, quats, log_scales)
        _place_rows(rows, frames, self._table, arrays, (*arrays, np.empty(len(frames), np.float32)), False)

    def update(self, state: SceneState, time: float, lag: PhotoLag | None = None) -> None:
        """Bring everything to another state with the same rows, and to a time (seconds), as a photo with this `lag`
        shows it."""
        before = self.state
        if state is before and (time, lag) == self._moment:
            return
        renamed = np.zeros(0, np.int64)
        if state.nodes is not before.nodes or state.move_entries is not before.move_entries:
            renamed = np.flatnonzero((state.nodes != before.nodes) | (state.move_entries != before.move_entries))
        existed = self._table[:, _EXISTS]
        changed = self._move(renamed, state, (time, lag)) or state.color_values is not before.color_values
        hidden = state.flags is not before.flags and ((state.flags ^ before.flags) & NOT_DRAWN).any()
        recolored = state.color_entries is not before.color_entries
        if changed or hidden or recolored or not np.array_equal(existed, self._table[:, _EXISTS]):
            self._set_opacities(state)
            self.look_version += 1
        self.state, self._moment = state, (time, lag)

    def _move(self, renamed: Int64[ndarray, " k"], state: SceneState, moment: Moment) -> bool:
        """Assign frames to rows, and place those rows and all whose frame has moved; returns whether there were any."""
        nodes, moves = state.nodes[renamed].astype(np.int64), state.move_entries[renamed]
        width = len(state.move_matrices)
        pairs = nodes * width + moves
        names = np.zeros((int(pairs.max()) + 1) if len(pairs) else 0, np.int32)
        names[pairs] = 1
        for pair in np.flatnonzero(names).tolist():
            names[pair] = self._frame_of.setdefault(divmod(pair, width), len(self._frame_of))
        self.frames[renamed] = names[pairs]
        before, self._table = self._table, _build_frame_table(list(self._frame_of), state, moment)
        shifted = np.ones(len(self._table), bool)
        shifted[: len(before)] = (self._table[: len(before), :_EXISTS] != before[:, :_EXISTS]).any(axis=1)
        rows = renamed
        if shifted.any():
            elsewhere = shifted[self.frames]
            elsewhere[renamed] = True
            rows = np.flatnonzero(elsewhere)
        self._place(rows)
        return len(rows) > 0

    def _place(self, rows: Int64[ndarray, " k"]) -> None:
        if self.means is self._stored[0] and self.frames[rows].any():
            self.means, self.quats, self.log_scales = (array.copy() for array in self._stored)
        shown = (self.means, self.quats, self.log_scales, self.areas)
        _place_rows(rows, self.frames, self._table, self._stored, shown, self.means is self._stored[0])

    def _set_opacities(self, state: SceneState) -> None:
        exists, alphas = self._table[:, _EXISTS] > 0, to_kernel_array(state.color_values[:, 12])
        entries = (self.frames, state.color_entries, state.flags)
        _fill_opacities(self._base_opacities, entries, exists, alphas, NOT_DRAWN, self.opacities)


def _build_frame_table(pairs: list[tuple[int, int]], state: SceneState, moment: Moment) -> Float64[ndarray, "f 18"]:
    """Compute where pairs of node and move lie; a move that was undone, which no row names, counts as none."""
    poses, present = find_node_poses(state.actors, *moment)
    nodes, moves = np.array(pairs).T
    table = np.zeros((len(pairs), _FRAME_FLOATS))
    known = nodes < len(poses)
    nodes, moves = nodes[known], moves[known]
    matrices = state.move_matrices[np.where(moves < len(state.move_matrices), moves, 0)]
    scales = np.linalg.norm(matrices[:, :, 0], axis=1)
    rotations = extract_node_rotations(poses)[nodes] @ matrices[:, :, :3] / scales[:, None, None]
    table[known, :_OFFSET] = rotations.reshape(-1, 9)
    offsets = poses[nodes, :3, :3] @ matrices[:, :, 3:]
    table[known, _OFFSET:_QUAT] = offsets[..., 0] + poses[nodes, :3, 3]
    table[known, _QUAT:_SCALE] = quaternion_from_matrix(rotations)
    table[known, _SCALE], table[known, _EXISTS] = scales, present[nodes]
    return table


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def _place_rows(rows, frames, table, stored, shown, is_unmoved):
    """Compute x → s R x + t, rotate quaternions and scale standard deviations; what never moved keeps its bits.

    `shown` may begin with the arrays of `stored`. Where all is unmoved, only areas are written.
    """
    means, quats, log_scales = stored
    for k in numba.prange(len(rows)):
        i = rows[k]
        f = frames[i]
        scale, growth = table[f, _SCALE], np.log(table[f, _SCALE])
        s0, s1, s2 = log_scales[i, 0] + growth, log_scales[i, 1] + growth, log_scales[i, 2] + growth
        shown[3][i] = np.exp(s0 + s1 + s2 - min(s0, s1, s2))
        if is_unmoved:
            continue
        for axis in range(3):
            shown[2][i, axis] = log_scales[i, axis] + growth
            shown[0][i, axis] = means[i, axis]
        for part in range(4):
            shown[1][i, part] = quats[i, part]
        if f == 0:
            continue
        x, y, z = means[i, 0] * scale, means[i, 1] * scale, means[i, 2] * scale
        for axis in range(3):
            turned = table[f, 3 * axis] * x + table[f, 3 * axis + 1] * y + table[f, 3 * axis + 2] * z
            shown[0][i, axis] = turned + table[f, _OFFSET + axis]
        aw, ax, ay, az = table[f, _QUAT], table[f, _QUAT + 1], table[f, _QUAT + 2], table[f, _QUAT + 3]
        bw, bx, by, bz = quats[i, 0], quats[i, 1], quats[i, 2], quats[i, 3]
        shown[1][i, 0] = aw * bw - ax * bx - ay * by - az * bz
        shown[1][i, 1] = aw * bx + ax * bw + ay * bz - az * by
        shown[1][i, 2] = aw * by - ax * bz + ay * bw + az * bx
        shown[1][i, 3] = aw * bz + ax * by - ay * bx + az * bw


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def _fill_opacities(base, entries, exists, alphas, not_drawn, opacities):
    frames, color_entries, flags = entries
    for i in numba.prange(len(base)):
        drawn = (flags[i] & not_drawn) == 0 and exists[frames[i]]
        opacities[i] = base[i] * alphas[color_entries[i]] if drawn else np.float32(0)
