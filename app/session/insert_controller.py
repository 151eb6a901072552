"""Inserting other scenes: in front of the camera, side by side, on the ground, selected; clouds of points where their
coordinates have them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_app.messages import read_error
from instdrive_app.session.context import SessionContext
from instdrive_app.session.move_controller import MoveController
from instdrive_app.state import Viewpoint
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.insert import InsertScene
from instdrive_core.edits.queries.coordinates import FARTHEST_MIDDLE, measure_distance, measure_offset
from instdrive_core.edits.queries.placement import estimate_foot, find_ground_below, find_solid
from instdrive_core.errors import EditError
from instdrive_core.formats.registry import find_stated_up, open_scene
from instdrive_core.instances.table import compute_middle_bounds
from instdrive_core.maths.vectors import Vector
from instdrive_core.scene.scene import Scene, place_in_world
from instdrive_core.scene.up_estimate import UpEstimate, estimate_up
from instdrive_core.wording import phrase

NEAREST = 8.0
"""Metres from the camera to a small inserted object; larger ones stand farther away."""
GAP = 1.0
"""Metres between scenes inserted together."""
EYE_HEIGHT = 1.6
"""Metres below the camera at which a scene stands where no ground is found."""


class InsertController:
    """Opens scenes in the background and inserts them into the open document."""

    def __init__(
        self,
        context: SessionContext,
        movement: MoveController,
        ask_up: Callable[[UpEstimate, tuple[int, ...]], None],
    ) -> None:
        """`ask_up` gets, of each scene of another program, which way seems to be up, and the instances it became."""
        self._context, self._state, self._jobs = context, context.state, context.jobs
        self._messages, self._movement, self._ask_up = context.messages, movement, ask_up

    def insert(self, path: Path, *others: Path) -> None:
        """Insert scene files or folders, one step each; they are selected, and the move tool is taken.

        What cannot be read is reported and left out.
        """
        self._insert_next((path, *others), None)

    def _insert_next(self, paths: tuple[Path, ...], edge: float | None) -> None:
        """Insert the first path, then the others; `edge`: where the scene inserted before ends (see `Spot`).

        One after the other, because the ground is searched in the background, in a document that must not change.
        """
        document, viewpoint, time = self._context.document, self._state.viewpoint, self._state.time
        if document is None or not paths:
            return
        path, others = paths[0], paths[1:]

        def work() -> tuple[InsertScene, Spot, UpEstimate | None]:
            source = (document.open_scene or open_scene)(path)
            spot = find_spot(document, source, viewpoint, time, edge)
            edit = InsertScene.from_scene(source, str(path), spot.translation)
            edit.prepare(document)
            return edit, spot, estimate_foreign_up(source, path)

        def finish(result: tuple[InsertScene, Spot, UpEstimate | None]) -> None:
            edit, spot, estimate = result
            mode = "replace" if edge is None else "add"
            if self._context.document is document and self._movement.apply_and_select(edit, edit.added_instances, mode):
                self._state.tool = "move"
                self._messages.info(_tell_place(path.name, spot.note))
                if estimate is not None:
                    self._ask_up(estimate, edit.added_ids)
                self._insert_next(others, spot.edge)

        def handle_failure(_: BaseException) -> bool:
            self._insert_next(others, edge)
            return False

        self._jobs.submit(phrase("Inserting {name}", name=path.name), work, finish, on_failure=handle_failure)


@dataclass(frozen=True)
class Spot:
    """Where a scene is inserted."""

    translation: Vector
    """Metres by which the scene has to be moved."""
    edge: float
    """Where the moved scene ends: metres to the right of the camera's axis."""
    note: str
    """What the user should know about it."""


def estimate_foreign_up(source: Scene, path: Path) -> UpEstimate | None:
    """Estimate which way is up in a scene of another program; None for this program's own, which stand upright."""
    if len(source.table) or source.views or source.start is not None:
        return None
    return estimate_up(source, find_stated_up(path))


def find_spot(document: Document, source: Scene, viewpoint: Viewpoint, time: float, edge: float | None = None) -> Spot:
    """Find a place on the ground in front of the camera; right of `edge` where a scene was inserted already. Clouds of
    points that lie near the scene stay where they are.

    Raises EditError where the scene has no splats.
    """
    if not len(source):
        raise EditError("the scene to be inserted has no splats")
    means = _find_solid_means(source, time)
    low, high = np.array(compute_middle_bounds(means))
    if is_made_of_points(source) and measure_distance(document, source, 0.5 * (low + high)) < FARTHEST_MIDDLE:
        x, y, z = measure_offset(document, source).tolist()
        return Spot((x, y, z), 0.0, phrase("where its coordinates have it"))
    size, right = (high - low)[:2], _find_right(viewpoint)
    half_width = float(np.abs(right[:2]) @ size) / 2
    aside = 0.0 if edge is None else edge + GAP + half_width
    place = _find_place_ahead(viewpoint, float(size.max())) + aside * right
    bottom = estimate_foot(means[:, 2])
    note = ""
    try:
        ground = find_ground_below(document, (), place)
    except EditError as error:
        ground = float(viewpoint.position[2]) - EYE_HEIGHT
        note = phrase("{error}, so it stands {height:g} m below the camera", error=read_error(error), height=EYE_HEIGHT)
    x, y = (place - (low + high) / 2)[:2].tolist()
    return Spot((x, y, ground - bottom), aside + half_width, note)


def _tell_place(name: str, note: str) -> str:
    """Say that something was inserted, and what there is to say about the place."""
    return (
        phrase("Inserted {name}: {note}", name=name, note=phrase(note))
        if note
        else phrase("Inserted {name}", name=name)
    )


def is_made_of_points(source: Scene) -> bool:
    """Whether a scene was a cloud of points: round splats, and nothing else."""
    gaussians = source.gaussians
    if source.actors or len(source.table) or gaussians.sh_degree:
        return False
    return bool((gaussians.log_scales == gaussians.log_scales[:, :1]).all() and (gaussians.quats[:, 1:] == 0).all())


def _find_place_ahead(viewpoint: Viewpoint, size: float) -> Float64[ndarray, "3"]:
    """Find a place level with the camera ahead of it; the pivot where the camera looks down."""
    ahead = viewpoint.forward * [1.0, 1.0, 0.0]
    if np.linalg.norm(ahead) < 0.2:
        return viewpoint.pivot
    return viewpoint.position + ahead / np.linalg.norm(ahead) * max(NEAREST, 1.5 * size)


def _find_right(viewpoint: Viewpoint) -> Float64[ndarray, "3"]:
    """Compute the level unit vector that points right in the picture."""
    right = viewpoint.world_from_camera[:3, 0] * [1.0, 1.0, 0.0]
    length = np.linalg.norm(right)
    return right / length if length > 0.2 else np.array([1.0, 0.0, 0.0])


def _find_solid_means(source: Scene, time: float) -> Float64[ndarray, "n 3"]:
    gaussians = source.gaussians
    rows = np.flatnonzero(find_solid(gaussians.opacities))
    poses, _ = source.find_node_poses(time)
    means, _ = place_in_world(gaussians.means[rows], gaussians.quats[rows], source.nodes[rows], poses)
    return means.astype(np.float64)
