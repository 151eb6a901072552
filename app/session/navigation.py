"""Where the user looks from, and at which time of the drive."""

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
"""Number of splats that a viewpoint is chosen by."""

LOWEST, HIGHEST = -0.7, 0.2
"""Limits of the vertical part of the viewing direction after the scene was turned."""


class Navigation:
    """Sets camera and time of the view state; dataset cameras and time steps come from the open document."""

    def __init__(self, context: SessionContext) -> None:
        self._context, self._state = context, context.state
        self.timeline = Timeline(())
        self.playing = False
        """Whether the drive is playing."""
        self._play_clock = 0.0

    def enter(self, document: Document) -> None:
        """Choose the first view of a document: its first dataset camera, else one that shows everything."""
        scene = document.scene
        self.timeline = Timeline(scene.views, scene.actors)
        self._state.time, self._state.dataset_view = self.timeline.start, None
        if scene.views:
            self.look_through(0)
        else:
            self.look_from(camera.frame_scene(self.compute_world_means(())))

    def look_from(self, viewpoint: Viewpoint) -> None:
        """Leave the dataset camera and look from a viewpoint."""
        self._state.viewpoint, self._state.dataset_view = viewpoint, None

    def look_through(self, index: int) -> None:
        """Look through a dataset camera, at its time."""
        document = self._context.document
        assert document is not None
        view = document.scene.views[index]
        self._state.viewpoint = camera.view_from_camera(view, self._state.viewpoint.pivot_distance)
        self._state.dataset_view, self._state.time = index, view.time

    def set_time(self, time: float) -> None:
        """Show another time (seconds); a dataset camera moves to its nearest photo, whose time is then shown."""
        self._state.time = time
        current, document = self._state.dataset_view, self._context.document
        if current is not None and document is not None:
            name = document.scene.views[current].name
            self.look_through(self.timeline.find_nearest_view(name, time))

    def step(self, count: int) -> None:
        """Go `count` time steps forwards, from the end back to the start."""
        if self.timeline.steps:
            self.set_time(self.timeline.step_time(self._state.time, count))

    def choose_camera(self, name: str) -> None:
        """Look through the dataset camera of this name at the shown time."""
        self.look_through(self.timeline.find_nearest_view(name, self._state.time))

    def frame(self, ids: tuple[int, ...]) -> None:
        """Bring instances, or everything, into view."""
        if self._context.document is None:
            return
        means = self.compute_world_means(ids)
        if len(means):
            self.look_from(camera.frame_points(self._state.viewpoint, means))

    def follow_scene(self, matrix: Similarity) -> None:
        """Keep looking at the same thing, upright, after the whole scene was transformed by [s R | t].

        Where that would be from below or straight from above, everything is brought into view instead.
        """
        if self._state.dataset_view is not None:
            self.look_through(self._state.dataset_view)
            return
        self._state.viewpoint = camera.transform_viewpoint(self._state.viewpoint, matrix)
        if not LOWEST <= self._state.viewpoint.forward[2] <= HIGHEST:
            self.look_from(camera.frame_scene(self.compute_world_means(())))

    def look_down(self, ids: tuple[int, ...]) -> None:
        """Look at instances, or everything, from straight above."""
        if self._context.document is None:
            return
        means = self.compute_world_means(ids)
        if len(means):
            self.look_from(camera.look_straight_down(self._state.viewpoint, means))

    def compute_world_means(self, ids: tuple[int, ...]) -> Float[ndarray, "n 3"]:
        """Compute world positions of instances, or of everything, at the shown time, without deleted splats.

        Returns every k-th of many splats: choosing a viewpoint needs no more, and a million take longer than a frame.
        """
        document = self._context.document
        assert document is not None
        scene = document.scene
        rows = document.find_rows(ids) if ids else np.arange(len(scene))
        rows = rows[:: 1 + len(rows) // MAX_LOOKED_AT]
        rows = rows[(document.state.flags[rows] & Flag.DELETED) == 0]
        poses, _ = scene.find_node_poses(self._state.time)
        matrices = poses[scene.nodes[rows]]
        return np.einsum("nij,nj->ni", matrices[:, :3, :3], document.compute_means(rows)) + matrices[:, :3, 3]

    def tick(self, seconds: float) -> None:
        """Advance a playing drive by `seconds`; called once a frame."""
        steps = self.timeline.steps
        if not self.playing or len(steps) < 2:
            return
        self._play_clock += seconds
        pace = (self.timeline.end - self.timeline.start) / (len(steps) - 1)
        if self._play_clock >= pace:
            self._play_clock = min(self._play_clock - pace, pace)
            self.step(1)
