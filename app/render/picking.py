"""Which instances are under a pixel of the frame shown, decided as `rasterize.preview` decides its winners."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy import ndarray

from instdrive_app.render.pickable_splats import PickableSplats
from instdrive_app.state import ID_ALPHA_CUT, FrameSnapshot
from instdrive_core.edits.document import Document
from instdrive_core.rasterize.pixel import Contributors, contributors_among, rows_near, winner_of
from instdrive_core.rasterize.preview import DEFAULT_PICK_RULE
from instdrive_core.rasterize.settings import settings_for


class Picker:
    """Keeps what clicks need of the last document, and the last answer."""

    def __init__(self) -> None:
        self._splats: PickableSplats | None = None
        self._answer: tuple[tuple, tuple[int, ...]] | None = None

    def instances_at(self, document: Document, snapshot: FrameSnapshot, x: float, y: float) -> tuple[int, ...]:
        """Instances at a position of the picture: the one that the pixel stands for, then those behind it.

        Empty outside the picture, and where the pixel stands for nothing or for a splat without an instance.
        """
        camera, column, row = snapshot.camera, int(np.floor(x)), int(np.floor(y))
        if not (0 <= column < camera.width and 0 <= row < camera.height):
            return ()
        if self._splats is None or self._splats.document is not document:
            self._splats, self._answer = PickableSplats(document), None
        pose = camera.world_from_camera.tobytes()
        lens = (camera.fx, camera.fy, camera.cx, camera.cy)
        key = (column, row, pose, lens, snapshot.time, snapshot.id_opacity, _versions(document))
        if self._answer is None or self._answer[0] != key:
            self._splats.update(snapshot.time)
            self._answer = (key, _found(self._splats, snapshot, column, row))
        return self._answer[1]


def _versions(document: Document) -> tuple:
    looks = (document.state.version, document.colors.version)
    return (*looks, document.geometry_version, document.rows_version, document.table_version)


def _found(splats: PickableSplats, snapshot: FrameSnapshot, column: int, row: int) -> tuple[int, ...]:
    camera, opacities, ids = snapshot.camera, splats.opacities, splats.document.scene.instance_ids
    settings = settings_for(splats.document.scene)
    near = rows_near(splats.means, splats.log_sizes, opacities, camera, column, row, settings)
    shape = splats.means[near], *splats.shapes(near), opacities[near]
    contributors = contributors_among(near, *shape, camera, column, row, settings)
    rule = replace(DEFAULT_PICK_RULE, min_opacity=snapshot.id_opacity, min_alpha=ID_ALPHA_CUT)
    winner = winner_of(contributors, rule)
    first = int(ids[winner]) if winner >= 0 else 0
    if first == 0:
        return ()
    behind = ids[_solid_rows_behind(contributors, winner, snapshot.id_opacity)]
    return tuple(dict.fromkeys([first, *(i for i in behind.tolist() if i)]))


def _solid_rows_behind(contributors: Contributors, winner: int, min_opacity: float) -> ndarray:
    """Rows from the winner's depth on, whose fragments the ID view would draw."""
    start = int(np.argmax(contributors.rows == winner))
    solid = (contributors.opacities >= min_opacity) & (contributors.alphas >= ID_ALPHA_CUT)
    return contributors.rows[start:][solid[start:]]
