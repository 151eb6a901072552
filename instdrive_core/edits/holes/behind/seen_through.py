"""Where photos look through what a fill would put behind a deleted thing: nothing stands there."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, Float64, Int64
from numpy import ndarray

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.queries.photo_parts import NEAREST
from instdrive_core.edits.queries.photographed import draw_photographed, read_depths, restore_drives
from instdrive_core.scene.camera import Camera, CameraView
from instdrive_core.scene.transforms import copy_shapes_at_home

MOST_PHOTOS = 16
"""Photos that are asked about one look's gap: spread over the steps of those that show its places."""
MOST_PIXELS = 16_000
"""Pixels of a photo; it is made smaller where it has more."""
LEAST_SHARE = 0.1
"""Share of the places that a photo must show to be asked."""
SLACK, SLACK_SHARE = 0.5, 0.1
"""Metres along the viewing axis by which a place may lie before what is seen there and be the same, and the share of
its distance that is added: what is continued is not known better."""


class PhotoDepths:
    """How far the photos of a document saw, as they were taken: nothing moved, deleted or added."""

    def __init__(self, document: Document) -> None:
        self._scene = restore_drives(document)
        self._shapes = copy_shapes_at_home(document.scene.gaussians, document.transforms)
        self._known: dict[tuple[str, int], tuple[Camera, Float32[ndarray, "h w"]]] = {}

    def count_votes(self, points: Float64[ndarray, "n 3"]) -> tuple[Int64[ndarray, " n"], Int64[ndarray, " n"]]:
        """How many photos look through a place (metres, in the world), and how many see something there."""
        past, met = np.zeros(len(points), np.int64), np.zeros(len(points), np.int64)
        for view in self._choose_views(points):
            camera, depths = self._look(view)
            pixels, away = camera.project(points)
            framed = np.flatnonzero(camera.contains(pixels, away, NEAREST))
            columns, rows = np.floor(pixels[framed]).astype(int).T
            ahead = depths[rows, columns] - away[framed]
            slack = SLACK + SLACK_SHARE * away[framed]
            past[framed] += ahead > slack
            met[framed] += np.abs(ahead) <= slack
        return past, met

    def _choose_views(self, points: Float64[ndarray, "n 3"]) -> list[CameraView]:
        """Photos that show enough of the places, of every second step, fourth step, … until they are few.

        So they are far apart, and mostly those that were drawn for other places.
        """
        least, stride = max(LEAST_SHARE * len(points), 1), 1
        found = [
            view
            for view in self._scene.views
            if np.count_nonzero(view.camera.contains(*view.camera.project(points), NEAREST)) >= least
        ]
        while len(found) > MOST_PHOTOS and any(view.index % (2 * stride) for view in found):
            stride *= 2
            found = [view for view in found if view.index % stride == 0]
        return found[:MOST_PHOTOS]

    def _look(self, view: CameraView) -> tuple[Camera, Float32[ndarray, "h w"]]:
        key = (view.name, view.index)
        if key not in self._known:
            size = view.camera.width * view.camera.height
            camera = view.camera.scale(min(1.0, float(np.sqrt(MOST_PIXELS / size))))
            self._known[key] = camera, read_depths(draw_photographed(self._scene, self._shapes, view, camera))
        return self._known[key]
