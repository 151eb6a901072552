"""Inserting another scene: before the camera, on the ground, selected."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_app.jobs import Jobs
from instdrive_app.messages import Messages
from instdrive_app.moving import Moving
from instdrive_app.state import EditorState, Viewpoint
from instdrive_core.edits.document import Document
from instdrive_core.edits.insert import InsertScene
from instdrive_core.edits.parameters import Vector
from instdrive_core.edits.placement import foot_of, ground_under, solid
from instdrive_core.errors import EditError
from instdrive_core.formats.registry import open_scene
from instdrive_core.instances.table import middle_bounds
from instdrive_core.scene.scene import Scene, placed

NEAREST = 8.0
"""Metres before the camera at which a small thing is put; larger ones farther."""
EYE_HEIGHT = 1.6
"""Metres below the camera where no ground is found."""


class Inserting:
    """Opens a scene beside the window and puts it into the open document."""

    def __init__(
        self,
        state: EditorState,
        document: Callable[[], Document | None],
        jobs: Jobs,
        messages: Messages,
        moving: Moving,
    ) -> None:
        self._state, self._document, self._jobs, self._messages, self._moving = state, document, jobs, messages, moving

    def insert(self, path: Path) -> None:
        """Insert all of a scene file or folder; it is selected and taken in hand."""
        document, viewpoint, time = self._document(), self._state.viewpoint, self._state.time
        if document is None:
            return

        def work() -> tuple[InsertScene, str]:
            source = (document.open_scene or open_scene)(path)
            shift, note = translation_before(document, source, viewpoint, time)
            return InsertScene.of(source, str(path), shift), note

        def done(result: tuple[InsertScene, str]) -> None:
            edit, note = result
            if self._document() is document and self._moving.apply_and_select(edit, edit.added_instances):
                self._state.tool = "move"
                self._messages.info(f"Inserted {path.name}{note}")

        self._jobs.submit(f"Inserting {path.name}", work, done)


def translation_before(document: Document, source: Scene, viewpoint: Viewpoint, time: float) -> tuple[Vector, str]:
    """Metres by which a scene has to be moved to stand before the camera, and what the user should know about it.

    Raises EditError where the scene has no splats.
    """
    if not len(source):
        raise EditError("the scene to be inserted has no splats")
    means = _solid_means(source, time)
    low, high = np.array(middle_bounds(means))
    place = _place_before(viewpoint, float((high - low)[:2].max()))
    bottom = foot_of(means[:, 2])
    note = ""
    try:
        ground = ground_under(document, (), place)
    except EditError as error:
        ground, note = float(viewpoint.position[2]) - EYE_HEIGHT, f"; {error}, so it stands at the camera's foot height"
    x, y = (place - (low + high) / 2)[:2].tolist()
    return (x, y, ground - bottom), note


def _place_before(viewpoint: Viewpoint, size: float) -> Float64[ndarray, "3"]:
    """A place ahead (what is below the camera's level does not count); under the pivot where the camera looks down."""
    ahead = viewpoint.forward * [1.0, 1.0, 0.0]
    if np.linalg.norm(ahead) < 0.2:
        return viewpoint.pivot
    return viewpoint.position + ahead / np.linalg.norm(ahead) * max(NEAREST, 1.5 * size)


def _solid_means(source: Scene, time: float) -> Float64[ndarray, "n 3"]:
    gaussians = source.gaussians
    rows = np.flatnonzero(solid(gaussians.opacities))
    poses, _ = source.at(time)
    means, _ = placed(gaussians.means[rows], gaussians.quats[rows], source.nodes[rows], poses)
    return means.astype(np.float64)
