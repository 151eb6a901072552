"""Free space between cameras and the ground: which places the photos showed, and which were hidden."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np
from jaxtyping import Bool, Float64, Int64
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
    if not views:
        return seen, hidden
    cameras = np.stack([_camera_to_row(view.camera) for view in views])
    planes = np.concatenate([np.zeros((0, 4)), *(each.planes for each in occluders)])
    starts = np.cumsum([0, *(len(each.planes) for each in occluders)])
    spheres = np.array([[*each.center, each.radius] for each in occluders], np.float64).reshape(-1, 4)
    times = np.array([view.time for view in views], np.float64)
    near = np.zeros((len(views), len(occluders)), np.bool_)
    poses = np.tile(np.eye(3, 4), (len(views), len(occluders), 1, 1))
    for number, occluder in enumerate(occluders):
        if occluder.track is not None:
            poses[:, number] = [occluder.track.interpolate_pose(view.time, view.camera.lag)[:3] for view in views]
        near[:, number] = _find_near(occluder, times, cameras[:, 12:15], poses[:, number])
    moves = np.array([each.track is not None for each in occluders], np.bool_)
    points = np.ascontiguousarray(points, np.float64)
    _count(points, cameras, (planes, starts, spheres), (near, poses, moves), chosen, seen, hidden)
    return seen, hidden


def _camera_to_row(camera: Camera) -> Float64[ndarray, " 21"]:
    """Rotation (9) and translation (3) of camera_from_world, position (3), fx, fy, cx, cy, width, height."""
    matrix = camera.camera_from_world
    pinhole = (camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height)
    return np.array([*matrix[:3, :3].ravel(), *matrix[:3, 3], *camera.position, *pinhole], np.float64)


def _find_near(
    occluder: Occluder,
    times: Float64[ndarray, " v"],
    eyes: Float64[ndarray, "v 3"],
    poses: Float64[ndarray, "v 3 4"],
) -> Bool[ndarray, " v"]:
    """At which `times` (s) an occluder, whose frame then has these poses, can stand between a camera and ground that
    its photo shows."""
    centers = poses[:, :, :3] @ occluder.center + poses[:, :, 3]
    near = np.linalg.norm(centers - eyes, axis=1) <= MAX_DISTANCE + occluder.radius
    if occluder.track is None:
        return near
    return near & np.array([occluder.track.covers(time) for time in times.tolist()], bool)


def find_shown_points(points: Float64[ndarray, "n 3"], camera: Camera) -> Int64[ndarray, " k"]:
    """Which points on level ground a photo shows near and large enough, if nothing stands before them."""
    return np.flatnonzero(_find_shown(np.ascontiguousarray(points, np.float64), _camera_to_row(camera)))


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _find_shown(points: ndarray, camera: ndarray) -> ndarray:
    shown = np.zeros(len(points), np.bool_)
    for i in range(len(points)):
        shown[i] = _shows(camera[None], 0, (points[i, 0], points[i, 1], points[i, 2]))
    return shown


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def _count(
    points: ndarray,
    cameras: ndarray,
    hulls: tuple[ndarray, ndarray, ndarray],
    bodies: tuple[ndarray, ndarray, ndarray],
    chosen: int,
    seen: ndarray,
    hidden: ndarray,
) -> None:
    """Point by point: which photos show it, and what stands between."""
    starts = hulls[1]
    near, poses, moves = bodies
    for i in numba.prange(len(points)):
        place = points[i, 0], points[i, 1], points[i, 2]
        for view in range(len(cameras)):
            if not _shows(cameras, view, place):
                continue
            position = cameras[view, 12], cameras[view, 13], cameras[view, 14]
            blocked = False
            for number in range(len(moves)):
                if number >= chosen and blocked:
                    break
                if not near[view, number]:
                    continue
                point, eye = place, position
                if moves[number]:
                    point, eye = _enter(poses, view, number, place), _enter(poses, view, number, position)
                if _meets(hulls, starts[number], starts[number + 1], number, eye, point):
                    blocked = True
                    if number < chosen:
                        hidden[i] += 1
                        break
            if not blocked:
                seen[i] += 1


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _enter(poses, view, number, point):
    """A world point as an occluder's frame has it in a view."""
    x, y, z = (
        point[0] - poses[view, number, 0, 3],
        point[1] - poses[view, number, 1, 3],
        point[2] - poses[view, number, 2, 3],
    )
    return (
        x * poses[view, number, 0, 0] + y * poses[view, number, 1, 0] + z * poses[view, number, 2, 0],
        x * poses[view, number, 0, 1] + y * poses[view, number, 1, 1] + z * poses[view, number, 2, 1],
        x * poses[view, number, 0, 2] + y * poses[view, number, 1, 2] + z * poses[view, number, 2, 2],
    )


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _shows(cameras, view, point):
    """Whether a photo shows a point on level ground near and large enough, if nothing stands before it."""
    x, y, z = point
    height = z - cameras[view, 14]
    square = (x - cameras[view, 12]) ** 2 + (y - cameras[view, 13]) ** 2 + height * height
    if square >= MAX_DISTANCE**2:
        return False
    depth = cameras[view, 6] * x + cameras[view, 7] * y + cameras[view, 8] * z + cameras[view, 11]
    if not depth > 0 or cameras[view, 16] * PATCH * abs(height) < MIN_PIXELS * square:
        return False
    right = cameras[view, 0] * x + cameras[view, 1] * y + cameras[view, 2] * z + cameras[view, 9]
    down = cameras[view, 3] * x + cameras[view, 4] * y + cameras[view, 5] * z + cameras[view, 10]
    column = cameras[view, 15] * right / depth + cameras[view, 17]
    line = cameras[view, 16] * down / depth + cameras[view, 18]
    width, lines = cameras[view, 19], cameras[view, 20]
    return MARGIN <= column <= width - MARGIN and MARGIN <= line <= lines - MARGIN


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _meets(hulls, first, end, number, eye, point):
    """Whether the segment from `eye` to a point meets a convex hull: each face clips the segment from one end."""
    planes, spheres = hulls[0], hulls[2]
    ex, ey, ez = eye
    dx, dy, dz = point[0] - ex, point[1] - ey, point[2] - ez
    cx, cy, cz = spheres[number, 0] - ex, spheres[number, 1] - ey, spheres[number, 2] - ez
    square = dx * dx + dy * dy + dz * dz
    along = dx * cx + dy * cy + dz * cz
    nearest = min(max(along / max(square, 1e-12), 0.0), 1.0)
    gx, gy, gz = nearest * dx - cx, nearest * dy - cy, nearest * dz - cz
    if gx * gx + gy * gy + gz * gz > spheres[number, 3] ** 2:  # most segments pass far away: a cheap test first
        return False
    enter, leave = 0.0, 1.0
    for k in range(first, end):
        start = planes[k, 3] + planes[k, 0] * ex + planes[k, 1] * ey + planes[k, 2] * ez
        slope = planes[k, 0] * dx + planes[k, 1] * dy + planes[k, 2] * dz
        if slope < 0:
            enter = max(enter, -start / slope)
        elif slope > 0:
            leave = min(leave, -start / slope)
        elif start > 0:
            return False
        if enter >= leave:
            return False
    return True
