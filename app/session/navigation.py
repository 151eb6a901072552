"""Where the user looks from, and at which time of the drive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from weakref import ref

import numpy as np
from jaxtyping import Float, Float32, Float64, Int
from numpy import ndarray

from instdrive_app import camera
from instdrive_app.framing import frame_core, frame_scene, frame_thing
from instdrive_app.session.context import SessionContext
from instdrive_app.sights import Sight, find_overview, find_sights
from instdrive_app.state import Viewpoint
from instdrive_app.timeline import Timeline
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.queries.ground_height import estimate_ground_height, estimate_ground_heights
from instdrive_core.edits.queries.presence import find_time_there
from instdrive_core.scene.camera import CameraView
from instdrive_core.scene.selection import Flag
from instdrive_core.scene.transforms import Similarity
from instdrive_core.wording import phrase

MAX_LOOKED_AT = 20_000
"""Number of splats that a viewpoint is chosen by."""

CLEARANCE = 0.3
"""Metres above the ground that orbiting keeps …"""
CLEARANCE_SHARE = 0.05
"""… or this share of the distance to the pivot where that is less."""
GROUND_RADII = (4.0, 8.0, 16.0, 40.0)
"""Metres around the camera within which the ground below it is looked for, in this order."""
MIN_OPACITY_LOGIT = -2.0
"""Fainter splats do not count when a view is chosen."""

AROUND_PLACE = np.array(list(product((-2.0, 0.0, 2.0), (-2.0, 0.0, 2.0), (-0.5, 0.5))))
"""Offsets (metres) of what is to be seen around a place of the ground."""
LEAST_IN_VIEW = 0.2
"""Share of splats inside the film below which something counts as out of view."""
LOWEST, HIGHEST = -0.7, 0.2
"""Limits of the vertical part of the viewing direction after the scene was turned."""


@dataclass(frozen=True)
class _Start:
    """The view with which a document was opened."""

    viewpoint: Viewpoint
    dataset_view: int | None
    time: float


@dataclass(frozen=True)
class _Sketched:
    """A sketch that is looked at while its scene is being opened."""

    document: Document
    viewpoint: Viewpoint
    """From where it was shown first."""
    before: tuple[Viewpoint, int | None, float]
    """Viewpoint, dataset camera and time of the document that was open before."""


class Navigation:
    """Sets camera and time of the view state; dataset cameras and time steps come from the open document."""

    def __init__(self, context: SessionContext) -> None:
        self._context, self._state = context, context.state
        self.timeline = Timeline(())
        self.playing = False
        """Whether the drive is playing."""
        self._play_clock = 0.0
        self._start: _Start | None = None
        self._sketched: _Sketched | None = None
        self._ground: tuple[tuple[object, ...], Float32[ndarray, "n 3"]] | None = None

    @property
    def _document(self) -> Document | None:
        """The document that is looked at: the open one, or the sketch of one that is being opened."""
        return self._context.document if self._sketched is None else self._sketched.document

    def enter(self, document: Document) -> None:
        """Choose the first view of a document: its first dataset camera, else one that shows everything.

        Where a sketch of it was shown, that is the sketch's, and a user who has looked around in it stays there.
        """
        scene, sketched, seen = document.scene, self._sketched, self._state.viewpoint
        self._sketched = None
        self.timeline = Timeline(scene.views, scene.actors)
        self._state.time, self._state.dataset_view = self.timeline.start, None
        if scene.views:
            self.look_through(0)
        else:
            self.look_from(sketched.viewpoint if sketched is not None else self._find_first_viewpoint(document))
        self.keep_start()
        if sketched is not None and seen is not sketched.viewpoint:
            self.look_from(seen)

    def _find_first_viewpoint(self, document: Document) -> Viewpoint:
        """Find a viewpoint for a document that is looked at: its first dataset camera's, else one that shows it all."""
        scene, distance = document.scene, self._state.viewpoint.pivot_distance
        if scene.views:
            return camera.view_from_camera(scene.views[0], distance)
        if scene.start is not None:
            return camera.view_from_camera(CameraView(scene.start, "start view", 0, 0.0), distance)
        return frame_scene(self._find_framed_means())

    def begin_sketch(self, document: Document) -> None:
        """Look at a sketch of a scene that is being opened, as the whole will be looked at first."""
        state, earlier = self._state, self._sketched
        before = (state.viewpoint, state.dataset_view, state.time) if earlier is None else earlier.before
        self._sketched = _Sketched(document, state.viewpoint, before)  # what is framed
        self.playing = False
        self.look_from_kept(self._find_first_viewpoint(document), 0.0)
        self._sketched = _Sketched(document, state.viewpoint, before)

    def leave_sketch(self) -> None:
        """Return to the document that was open before the sketch; does nothing where the whole has been entered."""
        if self._sketched is not None:
            self._state.viewpoint, self._state.dataset_view, self._state.time = self._sketched.before
            self._sketched = None

    def keep_start(self) -> None:
        """Make the present view the one that `look_from_start` returns to."""
        self._start = _Start(self._state.viewpoint, self._state.dataset_view, self._state.time)

    def look_from_start(self) -> None:
        """Return to the view with which the document was opened."""
        start, document = self._start, self._context.document
        if start is None or document is None:
            return
        if start.dataset_view is not None and start.dataset_view < len(document.scene.views):
            self.look_through(start.dataset_view)
        else:
            self.look_from(start.viewpoint)
            self._state.time = start.time

    def orbit(self, viewpoint: Viewpoint, yaw: float, pitch: float) -> Viewpoint:
        """Turn a viewpoint about its pivot (radians), not below the ground unless the user wants to go there."""
        if not self._state.stay_above_ground or self._document is None:
            return camera.orbit(viewpoint, yaw, pitch)
        points = self._find_ground_points()
        clearance = min(CLEARANCE, CLEARANCE_SHARE * viewpoint.pivot_distance)

        def find_floor(place: Float[ndarray, "3"]) -> float:
            height = estimate_ground_height(points, place, GROUND_RADII)
            return -np.inf if height is None else height + clearance

        return camera.orbit_above(viewpoint, yaw, pitch, find_floor)

    def find_ground_height(self, place: Float[ndarray, "3"]) -> float | None:
        """Find the height (metres, z up) of the ground below a place; None where no ground is near."""
        if self._document is None:
            return None
        return estimate_ground_height(self._find_ground_points(), place, GROUND_RADII)

    def find_ground_heights(self, places: Float[ndarray, "k 3"]) -> Float64[ndarray, " k"]:
        """Find the heights of the ground below many places; NaN where no ground is near."""
        if self._document is None:
            return np.full(len(places), np.nan)
        return estimate_ground_heights(self._find_ground_points(), places, GROUND_RADII)

    def look_from(self, viewpoint: Viewpoint) -> None:
        """Leave the dataset camera and look from a viewpoint."""
        plain = viewpoint if viewpoint.lag is None else replace(viewpoint, lag=None)
        self._state.viewpoint, self._state.dataset_view = plain, None

    def look_from_kept(self, viewpoint: Viewpoint, time: float) -> None:
        """Look from a viewpoint at a time in seconds, without a dataset camera."""
        self.look_from(viewpoint)
        self._state.time = time

    def look_through(self, index: int) -> None:
        """Look through a dataset camera, at its time."""
        document = self._context.document
        assert document is not None
        view = document.scene.views[index]
        viewpoint = camera.view_from_camera(view, self._state.viewpoint.pivot_distance)
        self._state.viewpoint = replace(viewpoint, lag=view.camera.lag)
        self._state.dataset_view, self._state.time = index, view.time

    def set_time(self, time: float) -> None:
        """Show another time (seconds); a dataset camera moves to its nearest photo, whose time is then shown."""
        self._state.time = time
        current, document = self._state.dataset_view, self._context.document
        if current is not None and document is not None:
            name = document.scene.views[current].name
            self.look_through(self.timeline.find_nearest_view(name, time))

    def _go_to_time_of(self, ids: tuple[int, ...]) -> None:
        """Show the nearest time step at which one of these instances is there, if none is there now, and say so."""
        document = self._context.document
        if document is None or not ids:
            return
        before, time = self._state.time, find_time_there(document, ids, self.timeline.steps, self._state.time)
        if time != before:
            self.set_time(time)
            gone = (
                phrase("{name} is not there at {time:.2f} s", name=document.scene.table[ids[0]].name, time=before)
                if len(ids) == 1
                else phrase("Nothing of the selection is there at {time:.2f} s", time=before)
            )
            self._context.messages.info(phrase("{gone}; the view goes to {time:.2f} s", gone=gone, time=time))

    def step(self, count: int) -> None:
        """Go `count` time steps forwards, from the end back to the start."""
        if self.timeline.steps:
            self.set_time(self.timeline.step_time(self._state.time, count))

    def choose_camera(self, name: str) -> None:
        """Look through the dataset camera of this name at the shown time."""
        self.look_through(self.timeline.find_nearest_view(name, self._state.time))

    def frame(self, ids: tuple[int, ...]) -> None:
        """Bring instances into view; without any, what is shown, from the place of a photo if there is one."""
        if self._context.document is None:
            return
        if ids:
            self._go_to_time_of(ids)
            means = self.compute_world_means(ids)
            if len(means):
                self._frame_thing(ids, means)
            return
        means = self._find_framed_means()
        if len(means):
            self.look_from(self._find_overview(means))

    def _find_overview(self, means: Float[ndarray, "n 3"]) -> Viewpoint:
        """Look at all that is shown as a photo of this time did; at its dense part where no photo was taken in it."""
        document, viewpoint = self._context.document, self._state.viewpoint
        assert document is not None
        views = document.scene.views
        if document.scene.actors:  # where the rig was at another time, something may drive now
            nearest = self.timeline.find_nearest_view
            views = [views[nearest(name, self._state.time)] for name in self.timeline.camera_names]
        found = find_overview(views, means, viewpoint.forward)
        if found is not None:
            return found
        sights = self._find_sights((), np.mean(camera.find_main_box(means), axis=0))
        return self._frame_points(viewpoint, means, sights) if sights else frame_core(viewpoint, means)

    def bring_into_view(self, ids: tuple[int, ...]) -> None:
        """Frame instances that are out of view, or nearly so; where they are in view already the camera stays."""
        self._go_to_time_of(ids)
        means = self.compute_world_means(ids) if self._context.document is not None and ids else np.zeros((0, 3))
        if not len(means):
            return
        lens = self._state.viewpoint.lens
        seeing = self._state.viewpoint.fit_camera(lens.width, lens.height)
        if seeing.contains(*seeing.project(means), 0.0).mean() < LEAST_IN_VIEW:
            self._frame_thing(ids, means)

    def _frame_thing(self, ids: tuple[int, ...], means: Float[ndarray, "n 3"]) -> None:
        """Frame instances from where nothing that is shown stands before them."""
        sights = self._find_sights(ids, np.mean(camera.find_main_box(means), axis=0))
        self.look_from(self._frame_points(self._state.viewpoint, means, sights))

    def _frame_points(self, viewpoint: Viewpoint, points: Float[ndarray, "n 3"], sights: Sequence[Sight]) -> Viewpoint:
        """Frame points, roughly as a viewpoint looks, from where nothing that is shown stands before them."""
        document = self._context.document
        assert document is not None
        drawn = np.flatnonzero(document.state.drawn)
        stride = 1 + len(drawn) // MAX_LOOKED_AT
        others = drawn[::stride]
        others = others[document.scene.gaussians.opacity_logits[others] > MIN_OPACITY_LOGIT]
        widths = np.exp(np.sort(document.scene.gaussians.log_scales[others], axis=1)[:, 1:].sum(axis=1))
        areas = stride * np.pi * widths.astype(np.float64)
        return frame_thing(viewpoint, points, self._place(others), areas, sights)

    def _find_sights(self, ids: tuple[int, ...], middle: Float[ndarray, "3"]) -> tuple[Sight, ...]:
        """Find from where photos show instances, as far as they stand still or move as one."""
        document, time = self._context.document, self._state.time
        assert document is not None
        scene = document.scene
        nodes = {scene.table[i].node for i in ids}
        track = scene.actors[nodes.pop() - 1] if len(nodes) == 1 and 0 not in nodes else None
        return find_sights(scene.views, middle, track, time)

    def follow_scene(self, matrix: Similarity) -> None:
        """Keep looking at the same thing, upright, after the whole scene was transformed by [s R | t].

        Where that would be from below or straight from above, everything is brought into view instead.
        """
        if self._state.dataset_view is not None:
            self.look_through(self._state.dataset_view)
            return
        self._state.viewpoint = camera.transform_viewpoint(self._state.viewpoint, matrix)
        if self._start is not None:
            turned = camera.transform_viewpoint(self._start.viewpoint, matrix)
            self._start = replace(self._start, viewpoint=turned)
        if not LOWEST <= self._state.viewpoint.forward[2] <= HIGHEST:
            self.look_from(frame_scene(self._find_framed_means()))

    def look_down(self, ids: tuple[int, ...]) -> None:
        """Look at instances, or everything, from straight above."""
        if self._context.document is None:
            return
        self._go_to_time_of(ids)
        means = self.compute_world_means(ids)
        if len(means):
            self.look_from(camera.look_straight_down(self._state.viewpoint, means))

    def go_to_place(self, x: float, y: float) -> None:
        """Look at a place of the ground (metres) from nearby, in the direction in which the user looks now.

        Where photos show the place, it is looked at from one of them.
        """
        height = self.find_ground_height(np.array([x, y, 0.0]))
        place = np.array([x, y, self._state.viewpoint.pivot[2] if height is None else height])
        wanted = camera.look_at_ground(self._state.viewpoint, place)
        sights = find_sights(() if self._document is None else self._document.scene.views, place)
        self.look_from(self._frame_points(wanted, place + AROUND_PLACE, sights) if sights else wanted)

    def compute_world_means(self, ids: tuple[int, ...]) -> Float[ndarray, "n 3"]:
        """Compute world positions of instances, or of everything, at the shown time, without deleted splats.

        Moving objects that are not there then count where nothing else is: they stand where their tracks end.

        Returns every k-th of many splats: choosing a viewpoint needs no more, and a million take longer than a frame.
        """
        document = self._document
        assert document is not None
        rows = document.find_rows(ids) if ids else np.arange(len(document.scene))
        rows = rows[:: 1 + len(rows) // MAX_LOOKED_AT]
        rows = rows[(document.state.flags[rows] & Flag.DELETED) == 0]
        there = document.scene.find_node_poses(self._state.time)[1][document.scene.nodes[rows]] > 0
        return self._place(rows[there] if there.any() else rows)

    def _find_framed_means(self) -> Float[ndarray, "n 3"]:
        """World positions of what is shown and not faint; of all that is not deleted where too little is left."""
        document = self._document
        assert document is not None
        rows = np.flatnonzero(document.state.drawn)
        rows = rows[:: 1 + len(rows) // MAX_LOOKED_AT]
        solid = rows[document.scene.gaussians.opacity_logits[rows] > MIN_OPACITY_LOGIT]
        return self._place(solid) if len(solid) >= len(rows) / 4 and len(solid) else self.compute_world_means(())

    def _find_ground_points(self) -> Float32[ndarray, "n 3"]:
        """Some points of the background (world), kept while nothing is turned, moved or deleted."""
        document = self._document
        assert document is not None
        key = (ref(document), document.versions)
        if self._ground is None or self._ground[0] != key:
            rows = np.flatnonzero((document.scene.nodes == 0) & ((document.state.flags & Flag.DELETED) == 0))
            rows = rows[:: 1 + len(rows) // MAX_LOOKED_AT]
            self._ground = (key, document.compute_means(rows).astype(np.float32))
        return self._ground[1]

    def _place(self, rows: Int[ndarray, " n"]) -> Float[ndarray, "n 3"]:
        """World positions of rows at the shown time."""
        document = self._document
        assert document is not None
        scene = document.scene
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
