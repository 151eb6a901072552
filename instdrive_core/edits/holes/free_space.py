"""Free space between cameras and the ground: which places the photos showed, and which were hidden."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np
from jaxtyping import Float64, Int64
from numpy import ndarray
from scipy.spatial import ConvexHull, QhullError

from instdrive_core.instances.interiors import CompactObject
from instdrive_core.scene.camera import Camera, CameraView
from instdrive_core.scene.track import Track

MAX_DISTANCE = 40.0
"""Metres: photos from farther away show no ground that a splat could have been trained on."""
MIN_PIXELS = 0.5
"""Pixels that a square of `PATCH` metres on the ground must be high in a photo …"""
PATCH = 0.2
MARGIN = 2
"""… and pixels from the photo's border that it must lie inside."""


@dataclass(frozen=True)
class Occluder:
    """Something convex that stands on the ground and hides what is behind it and beneath it."""

    planes: Float64[ndarray, "k 4"]
    """Outward normals and offsets in its own frame."""
    center: Float64[ndarray, "3"]
    radius: float
    """Metres from the centre to the farthest corner."""
    track: Track | None = None
    """Track of the node whose frame this is; None = the world."""


def build_occluder(
    body: CompactObject, points: Float64[ndarray, "k 3"], floor: float, track: Track | None = None
) -> Occluder | None:
    """The hull of a body, reaching down to `floor` (metres, in the frame of `points`); None where it is flat.

    Ground beneath a car is dark in every photo: what is seen through the gap between the wheels does not count.
    """
    local = (points - body.center) @ body.axes
    kept = points[body.holds(local, margin=1e-6)]
    corners = np.concatenate([kept, np.c_[kept[:, :2], np.full(len(kept), floor)]])
    try:
        hull = ConvexHull(corners)
    except (QhullError, ValueError):
        return None
    corners = corners[hull.vertices]
    center = (corners.min(axis=0) + corners.max(axis=0)) / 2
    return Occluder(hull.equations, center, float(np.linalg.norm(corners - center, axis=1).max()), track)


def count_sightings(
    points: Float64[ndarray, "n 3"], views: Sequence[CameraView], occluders: Sequence[Occluder], chosen: int
) -> tuple[Int64[ndarray, " n"], Int64[ndarray, " n"]]:
    """Count in how many views each world point (on level ground, metres) is seen, and in how many the first
    `chosen` occluders hide it."""
    seen, hidden = np.zeros(len(points), np.int64), np.zeros(len(points), np.int64)
    for view in views:
        rows = find_shown_points(points, view.camera)
        if not len(rows):
            continue
        blocked, by_chosen = np.zeros(len(rows), bool), np.zeros(len(rows), bool)
        for number, occluder in enumerate(occluders):
            if not _is_within_reach(occluder, view):
                continue
            hit = _find_hidden(occluder, view, points[rows])
            blocked |= hit
            by_chosen |= hit & (number < chosen)
        seen[rows[~blocked]] += 1
        hidden[rows[by_chosen]] += 1
    return seen, hidden


def _is_within_reach(occluder: Occluder, view: CameraView) -> bool:
    """Whether an occluder can stand between a camera and ground that its photo shows."""
    center, reach = occluder.center, MAX_DISTANCE + occluder.radius
    if occluder.track is not None:
        if not occluder.track.covers(view.time):
            return False
        center = occluder.track.interpolate_position(view.time)
        reach += float(np.linalg.norm(occluder.center))
    return bool(np.linalg.norm(center - view.camera.position) <= reach)


def find_shown_points(points: Float64[ndarray, "n 3"], camera: Camera) -> Int64[ndarray, " k"]:
    """Which points on level ground a photo shows near and large enough, if nothing stands before them."""
    offsets = points - camera.position
    distances = np.linalg.norm(offsets, axis=1)
    pixels, depths = camera.project(points)
    steepness = np.abs(offsets[:, 2]) / np.maximum(distances, 1e-6)
    large = camera.fy * PATCH * steepness >= MIN_PIXELS * distances
    framed = ((pixels >= MARGIN) & (pixels <= np.array([camera.width, camera.height]) - MARGIN)).all(axis=1)
    return np.flatnonzero(framed & (depths > 0) & (distances < MAX_DISTANCE) & large)


def _find_hidden(occluder: Occluder, view: CameraView, points: Float64[ndarray, "n 3"]) -> ndarray:
    eye = view.camera.position
    if occluder.track is not None:
        pose = occluder.track.interpolate_pose(view.time)
        points, eye = (points - pose[:3, 3]) @ pose[:3, :3], (eye - pose[:3, 3]) @ pose[:3, :3]
    points, eye = np.ascontiguousarray(points), np.ascontiguousarray(eye)
    return _find_met_segments(occluder.planes, occluder.center, occluder.radius, eye, points)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _find_met_segments(
    planes: Float64[ndarray, "k 4"],
    center: Float64[ndarray, "3"],
    radius: float,
    eye: Float64[ndarray, "3"],
    points: Float64[ndarray, "n 3"],
) -> ndarray:
    """Whether the segments from `eye` to the points meet a convex hull: each face clips the segment from one end."""
    met = np.zeros(len(points), np.bool_)
    for i in range(len(points)):
        square = 0.0
        nearest = 0.0
        for axis in range(3):
            step = points[i, axis] - eye[axis]
            square += step * step
            nearest += step * (center[axis] - eye[axis])
        nearest = min(max(nearest / max(square, 1e-12), 0.0), 1.0)
        away = 0.0
        for axis in range(3):
            gap = eye[axis] + nearest * (points[i, axis] - eye[axis]) - center[axis]
            away += gap * gap
        if away > radius * radius:  # most segments pass far away: a cheap test first
            continue
        enter, leave = 0.0, 1.0
        for k in range(len(planes)):
            start, slope = planes[k, 3], 0.0
            for axis in range(3):
                start += planes[k, axis] * eye[axis]
                slope += planes[k, axis] * (points[i, axis] - eye[axis])
            if slope < 0:
                enter = max(enter, -start / slope)
            elif slope > 0:
                leave = min(leave, -start / slope)
            elif start > 0:
                leave = -1.0
            if enter >= leave:
                break
        met[i] = enter < leave
    return met
