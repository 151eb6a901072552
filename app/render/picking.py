"""Which instances are under a pixel of the frame on screen, by the pick rule of `rasterize.preview`."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, UInt32
from numpy import ndarray

from instdrive_app.render.pickable_splats import PickableSplats
from instdrive_app.state import ID_ALPHA_CUT, FrameSnapshot
from instdrive_core.edits.document.document import Document
from instdrive_core.rasterize.kernels.settings import choose_raster_settings
from instdrive_core.rasterize.pixel_contributors import (
    Contributors,
    find_fragments_among,
    find_rows_near_pixel,
    pick_winner,
)
from instdrive_core.rasterize.preview import DEFAULT_PICK_RULE


class PickedInstances(NamedTuple):
    """Instances at one place of a picture, front to back."""

    seen: tuple[int, ...]
    """The instance that the pixel stands for, then those that contribute light to it."""
    hidden: tuple[int, ...]
    """Instances behind them that contribute nothing to the pixel."""


_NOTHING = PickedInstances((), ())


class Picker:
    """Finds instances under pixels; it keeps the splats of the last document, and the last answer."""

    def __init__(self) -> None:
        self._splats: PickableSplats | None = None
        self._answer: tuple[tuple[Any, ...], PickedInstances] | None = None

    def find_instances_at(self, document: Document, snapshot: FrameSnapshot, x: float, y: float) -> tuple[int, ...]:
        """Find the instances at a position of the picture (pixels): the one the pixel stands for, then those behind.

        The answer is empty outside the picture, and where the pixel stands for nothing or a splat without an instance.
        """
        below = self.find_below(document, snapshot, x, y)
        return below.seen + below.hidden

    def find_below(self, document: Document, snapshot: FrameSnapshot, x: float, y: float) -> PickedInstances:
        """Find the instances at a position of the picture (pixels), separated into seen and hidden ones."""
        camera, column, row = snapshot.camera, int(np.floor(x)), int(np.floor(y))
        if not (0 <= column < camera.width and 0 <= row < camera.height):
            return _NOTHING
        splats = self._choose_splats(document)
        pose = camera.world_from_camera.tobytes()
        lens = (camera.fx, camera.fy, camera.cx, camera.cy)
        key = (column, row, pose, lens, snapshot.time, camera.lag, snapshot.id_opacity, document.versions)
        if self._answer is None or self._answer[0] != key:
            splats.update(snapshot.time, camera.lag)
            self._answer = (key, _pick_instances(splats, snapshot, column, row))
        return self._answer[1]

    def find_row_at(self, document: Document, snapshot: FrameSnapshot, x: float, y: float) -> int | None:
        """Find the splat that a position of the picture (pixels) stands for; None where none is, or outside."""
        camera, column, row = snapshot.camera, int(np.floor(x)), int(np.floor(y))
        if not (0 <= column < camera.width and 0 <= row < camera.height):
            return None
        splats = self._choose_splats(document)
        splats.update(snapshot.time, camera.lag)
        winner = _find_fragments(splats, snapshot, column, row)[1]
        return winner if winner >= 0 else None

    def _choose_splats(self, document: Document) -> PickableSplats:
        if self._splats is None or self._splats.document is not document:
            self._splats, self._answer = PickableSplats(document), None
        return self._splats


def _find_fragments(splats: PickableSplats, snapshot: FrameSnapshot, column: int, row: int) -> tuple[Contributors, int]:
    """What reaches a pixel, front to back, and the row that it stands for; -1 for none."""
    camera, opacities = snapshot.camera, splats.opacities
    settings = choose_raster_settings(splats.document.scene)
    near = find_rows_near_pixel(splats.means, splats.log_sizes, opacities, camera, column, row, settings)
    shape = splats.means[near], *splats.compute_shapes(near), opacities[near]
    fragments = find_fragments_among(near, *shape, camera, column, row, settings)
    rule = replace(DEFAULT_PICK_RULE, min_opacity=snapshot.id_opacity, min_alpha=ID_ALPHA_CUT)
    return fragments, pick_winner(fragments.blended, rule, splats.document.scene.instance_ids, splats.names)


def _pick_instances(splats: PickableSplats, snapshot: FrameSnapshot, column: int, row: int) -> PickedInstances:
    ids = splats.document.scene.instance_ids
    fragments, winner = _find_fragments(splats, snapshot, column, row)
    first = int(ids[winner]) if winner >= 0 else 0
    if first == 0:
        return _NOTHING
    behind = _find_solid_behind(fragments, winner, snapshot.id_opacity)
    seen = _list_unique(first, ids[fragments.rows[behind & (fragments.weights > 0)]])
    return PickedInstances(seen, tuple(i for i in _list_unique(first, ids[fragments.rows[behind]]) if i not in seen))


def _find_solid_behind(fragments: Contributors, winner: int, min_opacity: float) -> Bool[ndarray, " k"]:
    """Find the fragments that the ID view would draw from the winner's depth on."""
    solid = (fragments.opacities >= min_opacity) & (fragments.alphas >= ID_ALPHA_CUT)
    solid[: int(np.argmax(fragments.rows == winner))] = False
    return solid


def _list_unique(first: int, ids: UInt32[ndarray, " k"]) -> tuple[int, ...]:
    return tuple(dict.fromkeys([first, *(i for i in ids.tolist() if i)]))
