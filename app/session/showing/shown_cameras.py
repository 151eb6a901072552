"""Where the clip's cameras stood: which of them are shown, how large, and the way that they were driven along."""

from __future__ import annotations

from collections.abc import Sequence
from weakref import ref

import numpy as np
from jaxtyping import Bool, Float64
from numpy import ndarray

from instdrive_app.session.context import SessionContext
from instdrive_app.session.navigation import Navigation
from instdrive_core.recording.ego_path import find_ego_way
from instdrive_core.scene.camera import Camera, CameraView
from instdrive_core.scene.track import Track

MOST_MOMENTS = 40
"""Moments whose cameras are shown where all are: of more, evenly chosen ones."""
DEPTHS = (0.04, 0.6)
"""Share of the cameras' extent, and metres, that a frustum is deep: the smaller counts …"""
LONE_DEPTH = 0.4
"""… and metres where all cameras stand at one place."""
NEAREST = 1.5
"""Depths of a frustum from the eye within which none is drawn: it would cover the picture."""
APEX_PIXELS = 7.0
"""Pixels around the place of a camera where the mouse finds it."""
MOST_WAY_POINTS = 120
LONGEST_STEP = 0.25
"""Share of the extent that neighbouring photos are apart on average, at most: else they are no way."""


class ShownCameras:
    """Chooses the cameras that are drawn in the view, and finds the one under the mouse."""

    def __init__(self, context: SessionContext, navigation: Navigation) -> None:
        self._context, self._navigation = context, navigation
        self._depth: tuple[object, float] = (None, LONE_DEPTH)
        self._frusta: tuple[object, Float64[ndarray, "n 5 3"]] = (None, np.zeros((0, 5, 3)))
        self._track: tuple[object, Track | None] = (None, None)
        self._way: tuple[object, Float64[ndarray, "n 3"] | None] = (None, None)

    def list_shown(self) -> tuple[int, ...]:
        """List the indices of the views whose cameras are drawn now; the one that is looked through is none."""
        document, state = self._context.document, self._context.state
        if document is None or not state.show_cameras:
            return ()
        views = document.scene.views
        shown = choose_moments(views) if state.show_all_cameras else choose_present(views, state.time)
        eye, reach = state.viewpoint.position, NEAREST * self.find_depth()
        is_near = (np.linalg.norm(self.find_frusta()[:, 0] - eye, axis=1) <= reach).tolist()
        return tuple(index for index in shown if index != state.dataset_view and not is_near[index])

    def find_depth(self) -> float:
        """Find how deep (metres) the frusta of the open document are."""
        document = self._context.document
        views = document.scene.views if document is not None else ()
        if self._depth[0] is not views:
            self._depth = (views, choose_depth(views))
        return self._depth[1]

    def find_frusta(self) -> Float64[ndarray, "n 5 3"]:
        """Find the frusta of all views, as `build_frustum` does."""
        document = self._context.document
        views = document.scene.views if document is not None else ()
        if self._frusta[0] is not views:
            frusta = [build_frustum(view.camera, self.find_depth()) for view in views]
            self._frusta = (views, np.array(frusta, np.float64).reshape(-1, 5, 3))
        return self._frusta[1]

    def find_at(self, camera: Camera, x: float, y: float) -> int | None:
        """Find the view whose camera is drawn at a pixel of the picture that `camera` shows; the nearest one."""
        document = self._context.document
        if document is None:
            return None
        shown = np.array(self.list_shown(), np.int64)
        frusta = self.find_frusta()[shown]
        found = np.flatnonzero(cover_pixel(frusta, camera, x, y))
        if not len(found):
            return None
        return int(shown[found[np.linalg.norm(frusta[found, 0] - camera.position, axis=1).argmin()]])

    def trace_way(self) -> Float64[ndarray, "n 3"] | None:
        """Trace the way of the recording car (metres, at its cameras' height); None where the photos are no drive."""
        track = self._find_track()
        return None if track is None else thin_way(track)

    def find_car(self, time: float) -> Float64[ndarray, "4 4"] | None:
        """Find world_from_car at a time (seconds): x right, y forward, z up; None where the photos are no drive."""
        track = self._find_track()
        return None if track is None else track.interpolate_pose(time)

    def _find_track(self) -> Track | None:
        document = self._context.document
        if document is None:
            return None
        key = (ref(document), document.versions.surroundings)
        if self._track[0] != key:
            self._track = (key, find_drive(document.scene.views))
        return self._track[1]

    def find_way(self) -> Float64[ndarray, "n 3"] | None:
        """Find the way of the recording car on the ground (metres); None where the photos are no drive."""
        document = self._context.document
        if document is None:
            return None
        key = (ref(document), document.versions.surroundings, document.versions.geometry)
        if self._way[0] != key:
            self._way = (key, self._put_on_ground())
        return self._way[1]

    def _put_on_ground(self) -> Float64[ndarray, "n 3"] | None:
        way = self.trace_way()
        if way is None:
            return None
        heights = self._navigation.find_ground_heights(way)
        known = np.flatnonzero(~np.isnan(heights))
        if len(known):
            way[:, 2] = np.interp(np.arange(len(way)), known, heights[known])
        return way


def choose_present(views: Sequence[CameraView], time: float) -> tuple[int, ...]:
    """Choose all views of the moment that is nearest to `time` (seconds)."""
    if not views:
        return ()
    nearest = min(views, key=lambda view: abs(view.time - time)).index
    return tuple(index for index, view in enumerate(views) if view.index == nearest)


def choose_moments(views: Sequence[CameraView]) -> tuple[int, ...]:
    """Choose the views of all moments, or of evenly spread ones where there are very many."""
    moments = sorted({view.index for view in views})
    kept = set(moments[:: -(-len(moments) // MOST_MOMENTS)]) if moments else set()
    return tuple(index for index, view in enumerate(views) if view.index in kept)


def choose_depth(views: Sequence[CameraView]) -> float:
    """Choose how deep (metres) frusta are: small beside the way of the cameras, in scenes of any unit."""
    if not views:
        return LONE_DEPTH
    places = np.stack([view.camera.position for view in views])
    extent = float(np.linalg.norm(np.ptp(places, axis=0)))
    return min(DEPTHS[0] * extent, DEPTHS[1]) if extent > 1e-6 else LONE_DEPTH


def build_frustum(camera: Camera, depth: float) -> Float64[ndarray, "5 3"]:
    """Build a frustum: the camera's place, the corners of its picture at `depth` metres, from left up clockwise."""
    x = (np.array([0, camera.width, camera.width, 0]) - camera.cx) / camera.fx
    y = (np.array([0, 0, camera.height, camera.height]) - camera.cy) / camera.fy
    local = depth * np.stack([x, y, np.ones(4)], axis=1)
    pose = camera.world_from_camera
    return np.concatenate([pose[None, :3, 3], local @ pose[:3, :3].T + pose[:3, 3]])


_FACES = ((1, 2, 3, 4), (0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 1))
"""Corners of each face of a frustum, in the order around it."""


def cover_pixel(frusta: Float64[ndarray, "n 5 3"], camera: Camera, x: float, y: float) -> Bool[ndarray, " n"]:
    """Which frusta, as `camera` sees them, cover a pixel: by one of their faces, or by the place of their camera."""
    pixels, depths = camera.project(frusta.reshape(-1, 3))
    corners = pixels.reshape(-1, 5, 2) - (x, y)
    covers = np.hypot(*corners[:, 0].T) <= APEX_PIXELS
    for face in _FACES:
        here, there = corners[:, face], np.roll(corners[:, face], -1, axis=1)
        turns = here[..., 0] * there[..., 1] - here[..., 1] * there[..., 0]
        covers |= (turns >= 0).all(axis=1) | (turns <= 0).all(axis=1)
    return covers & (depths.reshape(-1, 5) > 0.05).all(axis=1)


def find_drive(views: Sequence[CameraView]) -> Track | None:
    """Find the way of the recording car from the camera with the most photos; None where photos follow no way."""
    if len({view.time for view in views}) < 2:
        return None
    track = find_ego_way(views)
    way = track.world_from_box[:, :3, 3]
    extent = float(np.linalg.norm(np.ptp(way, axis=0)))
    steps = np.linalg.norm(np.diff(way, axis=0), axis=1)
    is_scattered = len(way) > 4 and float(steps.mean()) > LONGEST_STEP * extent
    return None if extent < 1e-6 or is_scattered else track


def thin_way(track: Track) -> Float64[ndarray, "n 3"]:
    """Thin the places of a track (metres) to a few that show its way."""
    way = track.world_from_box[:, :3, 3]
    return way[np.unique(np.linspace(0, len(way) - 1, min(len(way), MOST_WAY_POINTS)).round().astype(int))].copy()
