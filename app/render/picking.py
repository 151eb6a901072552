"""Which instances are under a pixel of the frame shown, decided as `rasterize.preview` decides its winners."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from instdrive_app.state import ID_ALPHA_CUT, FrameSnapshot
from instdrive_core.edits.document import Document
from instdrive_core.maths.activations import sigmoid
from instdrive_core.rasterize.pixel import Contributors, pixel_contributors, winner_of
from instdrive_core.rasterize.preview import DEFAULT_PICK_RULE
from instdrive_core.scene.scene import placed


class Picker:
    """Keeps the placed splats of the last document and moment, and the last answer."""

    def __init__(self) -> None:
        self._document: Document | None = None
        self._time: float | None = None
        self._versions: tuple[int, int] | None = None
        self._means = self._quats = self._opacities = np.zeros(0, np.float32)
        self._present = np.zeros(0, np.uint8)
        self._answer: tuple[tuple, tuple[int, ...]] | None = None

    def instances_at(self, document: Document, snapshot: FrameSnapshot, x: float, y: float) -> tuple[int, ...]:
        """Instances at a position of the picture: the one that the pixel stands for, then those behind it.

        Empty outside the picture, and where the pixel stands for nothing or for a splat without an instance.
        """
        camera, column, row = snapshot.camera, int(np.floor(x)), int(np.floor(y))
        if not (0 <= column < camera.width and 0 <= row < camera.height):
            return ()
        self._update(document, snapshot.time)
        pose = camera.world_from_camera.tobytes()
        lens = (camera.fx, camera.fy, camera.cx, camera.cy)
        key = (column, row, pose, lens, snapshot.time, snapshot.id_opacity, self._versions, document.table_version)
        if self._answer is None or self._answer[0] != key:
            self._answer = (key, self._found(document, snapshot, column, row))
        return self._answer[1]

    def _found(self, document: Document, snapshot: FrameSnapshot, column: int, row: int) -> tuple[int, ...]:
        means, quats, log_scales = self._means, self._quats, document.scene.gaussians.log_scales
        contributors = pixel_contributors(means, quats, log_scales, self._opacities, snapshot.camera, column, row)
        rule = replace(DEFAULT_PICK_RULE, min_opacity=snapshot.id_opacity, min_alpha=ID_ALPHA_CUT)
        winner = winner_of(contributors, self._opacities, rule)
        first = int(document.scene.instance_ids[winner]) if winner >= 0 else 0
        if first == 0:
            return ()
        behind = document.scene.instance_ids[self._solid_rows_behind(contributors, winner, snapshot.id_opacity)]
        return tuple(dict.fromkeys([first, *(i for i in behind.tolist() if i)]))

    def _solid_rows_behind(self, contributors: Contributors, winner: int, min_opacity: float) -> ndarray:
        """Rows from the winner's depth on, whose fragments the ID view would draw."""
        start = int(np.argmax(contributors.rows == winner))
        rows, alphas = contributors.rows[start:], contributors.alphas[start:]
        return rows[(self._opacities[rows] >= min_opacity) & (alphas >= ID_ALPHA_CUT)]

    def _update(self, document: Document, time: float) -> None:
        scene = document.scene
        if document is not self._document or time != self._time:
            poses, self._present = scene.at(time)
            self._means, self._quats = placed(scene.gaussians.means, scene.gaussians.quats, scene.nodes, poses)
            self._document, self._time, self._versions = document, time, None
        versions = (document.state.version, document.colors.version)
        if versions != self._versions:
            self._opacities = visible_opacities(document, self._present)
            self._versions = versions


def visible_opacities(document: Document, present: ndarray) -> Float32[ndarray, " n"]:
    """Opacity of each splat as it is shown: recoloured, and 0 where it is hidden, deleted or its actor is absent."""
    scene, palette = document.scene, document.colors
    opacities = sigmoid(scene.gaussians.opacity_logits) * palette.alphas[palette.indices]
    shown = document.state.drawn & (present[scene.nodes] > 0)
    return np.where(shown, opacities, np.float32(0)).astype(np.float32)
