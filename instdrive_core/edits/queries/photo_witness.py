"""What the photos of a thing say about places around it: where its surface is seen, and where nothing of it stands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64
from numpy import ndarray

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.queries.photo_parts import NEAREST, choose_apart, cut_camera
from instdrive_core.edits.queries.photographed import draw_photographed, read_depths, restore_drives
from instdrive_core.scene.camera import Camera, CameraView
from instdrive_core.scene.scene import Scene

MOST_LOOKS = 8
"""Photos that are asked: those that show most of the thing."""
_LEAST_PIXELS = 300
"""Pixels of a photo that the thing must span to be looked at."""
_MOST_PIXELS = 12_000
"""Pixels of the part of a photo around the thing; it is made smaller where it has more."""
_NEAR = 0.15
"""Metres along the viewing axis within which a place lies on what is seen there."""
_ASLANT, _MOST_SLACK = 2.0, 0.4
"""Pixels over which the depth of what lies aslant is uncertain, and metres by which it is at most."""

_Test = Callable[[Float64[ndarray, " k"], Float32[ndarray, " k"], Bool[ndarray, " k"]], Bool[ndarray, " k"]]
"""Which places count, by metres behind what is seen there, by how aslant that is, and by whether it is the thing."""


@dataclass(frozen=True)
class _Look:
    """The part of one photo around the thing, in the frame of its node."""

    camera: Camera
    depth: Float32[ndarray, "h w"]
    """Metres; infinite where nothing is."""
    slack: Float32[ndarray, "h w"]
    """Metres by which depth is uncertain, since what is seen lies aslant."""
    is_thing: Bool[ndarray, "h w"]


@dataclass(frozen=True)
class PhotoWitness:
    """The photos that show a thing, as they were taken: nothing moved, deleted or added."""

    looks: tuple[_Look, ...]

    def count_seen(self, points: Float64[ndarray, "n 3"]) -> Int64[ndarray, " n"]:
        """Count the photos in which points (metres, in the frame of the thing's node) lie on its visible surface."""
        return self._count(points, lambda ahead, slack, own: own & (np.abs(ahead) <= _NEAR + slack))

    def count_in_sight(self, points: Float64[ndarray, "n 3"]) -> Int64[ndarray, " n"]:
        """Count the photos that would show something at points: on the thing's surface, or before all that is seen."""
        return self._count(points, lambda ahead, slack, own: ahead <= _NEAR)

    def count_past(self, points: Float64[ndarray, "n 3"]) -> Int64[ndarray, " n"]:
        """Count the photos that look past points, at something behind: the thing does not reach there."""
        return self._count(points, lambda ahead, slack, own: ahead < -(_NEAR + slack))

    def _count(self, points: Float64[ndarray, "n 3"], holds: _Test) -> Int64[ndarray, " n"]:
        counts = np.zeros(len(points), np.int64)
        for look in self.looks:
            pixels, depths = look.camera.project(points)
            framed = np.flatnonzero(look.camera.contains(pixels, depths, NEAREST))
            columns, rows = np.floor(pixels[framed]).astype(int).T
            ahead = depths[framed] - look.depth[rows, columns]
            counts[framed] += holds(ahead, look.slack[rows, columns], look.is_thing[rows, columns])
        return counts


def ask_photos(document: Document, number: int, rows: Int64[ndarray, " k"]) -> PhotoWitness:
    """Ask the photos that show most of an instance, of which `rows` are the solid splats as the file has them.

    A photo is what the scene shows from its camera, before any edit. Without photo cameras, nobody says anything.
    """
    scene = document.scene
    node = scene.table[number].node
    points = scene.gaussians.means[rows].astype(np.float64)
    photographed = restore_drives(document)
    own = scene.instance_ids == number
    looks = []
    for view, camera in _choose_views(photographed, points, node):
        poses, _ = photographed.find_node_poses(view.time, view.camera.lag)
        shown = draw_photographed(photographed, scene.gaussians, view, camera)
        is_thing = (shown.winner >= 0) & own[np.maximum(shown.winner, 0)]
        posed = replace(camera, world_from_camera=np.linalg.inv(poses[node]) @ camera.world_from_camera)
        looks.append(_Look(posed, read_depths(shown), _measure_slack(shown.depth), is_thing))
    return PhotoWitness(tuple(looks))


def _measure_slack(depth: Float32[ndarray, "h w"]) -> Float32[ndarray, "h w"]:
    """How much depth (metres) changes over `_ASLANT` pixels, up to `_MOST_SLACK`."""
    steps = [np.abs(np.gradient(depth, axis=axis)) for axis in (0, 1) if depth.shape[axis] > 1]
    slope = np.max([np.zeros_like(depth), *steps], axis=0)
    return np.minimum(_ASLANT * slope, _MOST_SLACK).astype(np.float32)


def _place(points: Float64[ndarray, "n 3"], pose: Float64[ndarray, "4 4"]) -> Float64[ndarray, "n 3"]:
    return points @ pose[:3, :3].T + pose[:3, 3]


def _choose_views(photographed: Scene, points: Float64[ndarray, "k 3"], node: int) -> list[tuple[CameraView, Camera]]:
    """Views in which the points span most pixels, and the cameras of the parts that do."""
    found = []
    for view in photographed.views:
        poses, present = photographed.find_node_poses(view.time, view.camera.lag)
        if not present[node]:
            continue
        pixels, depths = view.camera.project(_place(points, poses[node]))
        framed = view.camera.contains(pixels, depths, NEAREST)
        if np.count_nonzero(framed) < max(0.1 * len(points), 3):
            continue
        span = float(np.prod(np.ptp(pixels[framed], axis=0)))
        if span >= _LEAST_PIXELS:
            shown = np.clip(pixels[depths > NEAREST], 0, [view.camera.width, view.camera.height])
            found.append((span, view, cut_camera(view.camera, shown, _MOST_PIXELS)))
    return choose_apart(found, MOST_LOOKS)
