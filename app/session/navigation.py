"""Where the user looks from and at which moment of the drive."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from instdrive_app import camera
from instdrive_app.session.context import SessionContext
from instdrive_app.state import Viewpoint
from instdrive_app.timeline import Timeline
from instdrive_core.edits.document.document import Document
from instdrive_core.scene.selection import Flag
from instdrive_core.scene.transforms import Similarity

MAX_LOOKED_AT = 20_000
"""Splats that decide where something is looked at from."""

LOWEST, HIGHEST = -0.7, 0.2
"""Vertical part of the directions that one may look in after the scene was turned."""


class Navigation:
    """Writes camera and time of the view state; dataset cameras and moments come from the open document."""

    def __init__(self, context: SessionContext) -> None:
        self._context, self._state = context, context.state
        self.timeline = Timeline(())
        self.playing = False
        """Whether the drive plays."""
        self._play_clock = 0.0

    def enter(self, document: Document) -> None:
        """Look at a document for the first time: through its first dataset camera, else from where it fits."""
        scene = document.scene
        self.timeline = Timeline(scene.views, scene.actors)
        self._state.time, self._state.dataset_view = self.timeline.start, None
        if scene.views:
            self.look_through(0)
        else:
            self.look_from(camera.frame_scene(self.compute_world_means(())))

    def look_from(self, viewpoint: Viewpoint) -> None:
        """Leave the dataset camera and look from elsewhere."""
        self._state.viewpoint, self._state.dataset_view = viewpoint, None

    def look_through(self, index: int) -> None:
        """Look through a dataset camera, at its moment."""
        document = self._context.document
        assert document is not None
        view = document.scene.views[index]
        self._state.viewpoint = camera.view_from_camera(view, self._state.viewpoint.pivot_distance)
        self._state.dataset_view, self._state.time = index, view.time

    def set_time(self, time: float) -> None:
        """Show another moment; a dataset camera moves along to its nearest photo, the moment is then the photo's."""
        self._state.time = time
        current, document = self._state.dataset_view, self._context.document
        if current is not None and document is not None:
            name = document.scene.views[current].name
            self.look_through(self.timeline.find_nearest_view(name, time))

    def step(self, count: int) -> None:
        """Go `count` time steps onwards, around the ends."""
        if self.timeline.steps:
            self.set_time(self.timeline.step_time(self._state.time, count))

    def choose_camera(self, name: str) -> None:
        """Look through the dataset camera of this name at the present moment."""
        self.look_through(self.timeline.find_nearest_view(name, self._state.time))

    def frame(self, ids: tuple[int, ...]) -> None:
        """Bring instances, or everything, into view."""
        if self._context.document is None:
            return
        means = self.compute_world_means(ids)
        if len(means):
            self.look_from(camera.frame_points(self._state.viewpoint, means))

    def follow_scene(self, matrix: Similarity) -> None:
        """The whole scene was turned and scaled by [s R | t]: look at the same thing, but with the picture upright.

        Where that would be from below or straight from above, everything is brought into view instead.
        """
        if self._state.dataset_view is not None:
            self.look_through(self._state.dataset_view)
            return
        self._state.viewpoint = camera.transform_viewpoint(self._state.viewpoint, matrix)
        if not LOWEST <= self._state.viewpoint.forward[2] <= HIGHEST:
            self.look_from(camera.frame_scene(self.compute_world_means(())))

    def look_down(self, ids: tuple[int, ...]) -> None:
        """See instances, or everything, from straight above."""
        if self._context.document is None:
            return
        means = self.compute_world_means(ids)
        if len(means):
            self.look_from(camera.look_straight_down(self._state.viewpoint, means))

    def compute_world_means(self, ids: tuple[int, ...]) -> Float[ndarray, "n 3"]:
        """World positions of instances at the shown moment, deleted splats left out; of all for no IDs.

        Of many splats it is every k-th: a place to look from needs no more, and a million take longer than a frame.
        """
        document = self._context.document
        assert document is not None
        scene = document.scene
        rows = document.find_rows(ids) if ids else np.arange(len(scene))
        rows = rows[:: 1 + len(rows) // MAX_LOOKED_AT]
        rows = rows[(document.state.flags[rows] & Flag.DELETED) == 0]
        poses, _ = scene.at(self._state.time)
        matrices = poses[scene.nodes[rows]]
        return np.einsum("nij,nj->ni", matrices[:, :3, :3], document.compute_means(rows)) + matrices[:, :3, 3]

    def tick(self, seconds: float) -> None:
        """Once a frame: where the drive plays, go on by `seconds`."""
        steps = self.timeline.steps
        if not self.playing or len(steps) < 2:
            return
        self._play_clock += seconds
        pace = (self.timeline.end - self.timeline.start) / (len(steps) - 1)
        if self._play_clock >= pace:
            self._play_clock = min(self._play_clock - pace, pace)
            self.step(1)
