"""Moving the viewpoint: orbit, look around, pan, dolly, fly, frame a box, look through a dataset camera.

Pure functions from viewpoint to viewpoint. Angles in radians, distances in metres.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

from instdrive_app.state import Intrinsics, Viewpoint
from instdrive_core.scene.camera import CameraView, look_at
from instdrive_core.scene.pose_transforms import transform_pose
from instdrive_core.scene.transforms import Similarity, extract_scale

STEEPEST = 0.99
"""Largest |vertical part| of the viewing direction that a drag can tilt to."""
_MOST_RAISED, _RAISING_STEPS = 1.0, 8
"""Radians by which an orbit is raised at most to stay above the floor, and how finely that is tried."""
GROUND_DISTANCES, GROUND_SLOPES = (5.0, 30.0), (0.2, 0.9)
"""Metres from which a place of the ground is looked at, and how steeply: the vertical part of the viewing direction."""
NEAREST_PIVOT, FARTHEST_PIVOT = 0.3, 2000.0


def orbit(viewpoint: Viewpoint, yaw: float, pitch: float) -> Viewpoint:
    """Turn about the pivot: `yaw` about the world's vertical, `pitch` upwards about the camera's x axis."""
    pose = _turn(viewpoint.world_from_camera, yaw, pitch)
    pose[:3, 3] = viewpoint.pivot - viewpoint.pivot_distance * pose[:3, 2]
    return replace(viewpoint, world_from_camera=pose)


def orbit_above(
    viewpoint: Viewpoint, yaw: float, pitch: float, find_floor: Callable[[Float[ndarray, "3"]], float]
) -> Viewpoint:
    """Orbit, but no lower than the floor (metres, z up) that `find_floor` gives for a place.

    Where the camera is below the floor already, it sinks no farther.
    """
    moved = orbit(viewpoint, yaw, pitch)
    lowest = viewpoint.position[2]
    if moved.position[2] >= min(lowest, find_floor(moved.position)):
        return moved
    low, high = pitch, pitch - _MOST_RAISED
    for _ in range(_RAISING_STEPS):
        middle = (low + high) / 2
        raised = orbit(viewpoint, yaw, middle)
        if raised.position[2] >= min(lowest, find_floor(raised.position)):
            moved, high = raised, middle
        else:
            low = middle
    return moved


def look(viewpoint: Viewpoint, yaw: float, pitch: float) -> Viewpoint:
    """Turn on the spot, by less where the view is zoomed: what is seen moves as far over the screen."""
    turned = _turn(viewpoint.world_from_camera, yaw / viewpoint.zoom, pitch / viewpoint.zoom)
    return replace(viewpoint, world_from_camera=turned)


def pan(viewpoint: Viewpoint, right: float, down: float) -> Viewpoint:
    """Shift in the image plane."""
    return fly(viewpoint, np.array([right, down, 0.0]))


def pan_pixels(viewpoint: Viewpoint, dx: float, dy: float, focal: float) -> Viewpoint:
    """Shift so that the pivot follows a drag of (dx, dy) pixels; `focal` is the viewport camera's."""
    metres = viewpoint.pivot_distance / focal
    return pan(viewpoint, -dx * metres, -dy * metres)


def dolly(viewpoint: Viewpoint, factor: float) -> Viewpoint:
    """Move nearer to the pivot (`factor` < 1) or away from it; the pivot stays. Going away undoes a zoom first."""
    if factor > 1 and viewpoint.zoom > 1:
        return replace(viewpoint, zoom=max(viewpoint.zoom / factor, 1.0))
    distance = float(np.clip(viewpoint.pivot_distance * factor, NEAREST_PIVOT, FARTHEST_PIVOT))
    pose = viewpoint.world_from_camera.copy()
    pose[:3, 3] = viewpoint.pivot - distance * viewpoint.forward
    return replace(viewpoint, world_from_camera=pose, pivot_distance=distance)


def set_pivot_distance(viewpoint: Viewpoint, distance: float) -> Viewpoint:
    """Make orbiting turn about the point at `distance` (metres) along the axis; the view stays."""
    return replace(viewpoint, pivot_distance=float(np.clip(distance, NEAREST_PIVOT, FARTHEST_PIVOT)))


def fly(viewpoint: Viewpoint, step: Float[ndarray, "3"]) -> Viewpoint:
    """Move by (right, down, forward) in the camera's axes; the pivot comes along."""
    pose = viewpoint.world_from_camera.copy()
    pose[:3, 3] += pose[:3, :3] @ step
    return replace(viewpoint, world_from_camera=pose)


def lift(viewpoint: Viewpoint, up: float) -> Viewpoint:
    """Move along the world's vertical."""
    pose = viewpoint.world_from_camera.copy()
    pose[2, 3] += up
    return replace(viewpoint, world_from_camera=pose)


def find_main_box(points: Float[ndarray, "n 3"]) -> tuple[Float64[ndarray, "3"], Float64[ndarray, "3"]]:
    """Lower and upper corner of the box that holds most of the points (at least one) along each axis."""
    low, high = np.percentile(points, [2, 98], axis=0)
    return low, high


def frame_box(
    viewpoint: Viewpoint,
    low: Float[ndarray, "3"],
    high: Float[ndarray, "3"],
    direction: Float[ndarray, "3"] | None = None,
) -> Viewpoint:
    """Look at the centre of a box from where all of it is visible: along a unit vector, or roughly as now."""
    center, radius = (low + high) / 2, max(float(np.linalg.norm(high - low)) / 2, 0.2)
    lens = viewpoint.lens
    half_angle = np.arctan(min(lens.height / lens.fy, lens.width / lens.fx) / 2)
    distance = radius / np.sin(half_angle) * 1.1
    if direction is None:
        direction = viewpoint.forward.copy()
        direction[2] = min(direction[2], -0.25)
        direction /= np.linalg.norm(direction)
    return Viewpoint(look_at(center - distance * direction, center), lens, float(distance))


def view_from_camera(view: CameraView, pivot_distance: float = 10.0) -> Viewpoint:
    """Make the viewpoint of a dataset camera, with its pose and intrinsics."""
    return Viewpoint(view.camera.world_from_camera, Intrinsics.from_camera(view.camera), pivot_distance)


def look_at_ground(viewpoint: Viewpoint, place: Float[ndarray, "3"]) -> Viewpoint:
    """Look down at a place of the ground, from behind it as the view goes now, as far away as the pivot is now."""
    distance = float(np.clip(viewpoint.pivot_distance, *GROUND_DISTANCES))
    forward = viewpoint.forward[:2]
    level = float(np.hypot(*forward))
    ahead = forward / level if level > 0.1 else -viewpoint.world_from_camera[:2, 1]  # straight down: up the picture
    slope = float(np.clip(-viewpoint.forward[2], *GROUND_SLOPES))
    back = distance * np.array([*(-ahead * np.sqrt(1 - slope**2)), slope])
    return replace(viewpoint, world_from_camera=look_at(place + back, place), pivot_distance=distance, zoom=1.0)


def look_straight_down(viewpoint: Viewpoint, points: Float[ndarray, "n 3"]) -> Viewpoint:
    """Look straight down at most of the points (at least one), with the present heading up in the picture."""
    low, high = find_main_box(points)
    heading = viewpoint.forward * [1, 1, 0]
    if np.linalg.norm(heading) < 1e-6:  # looking down already: take the picture's up
        heading = -viewpoint.world_from_camera[:3, 1] * [1, 1, 0]
    heading /= np.linalg.norm(heading)
    down = np.array([0.0, 0.0, -1.0])
    turn = np.stack([np.cross(-heading, down), -heading, down], axis=1)
    around = (points - (low + high) / 2) @ turn
    half_width, half_height = np.maximum(np.percentile(np.abs(around[:, :2]), 98, axis=0), 0.2)
    lens = viewpoint.lens
    distance = 1.1 * max(2 * half_width * lens.fx / lens.width, 2 * half_height * lens.fy / lens.height)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, (low + high) / 2
    pose[2, 3] = high[2] + distance
    return Viewpoint(pose, lens, float(distance))


def transform_viewpoint(viewpoint: Viewpoint, matrix: Similarity) -> Viewpoint:
    """Move a viewpoint along with a scene transformed by [s R | t], then remove its roll."""
    pose = transform_pose(viewpoint.world_from_camera, matrix)
    level = look_at(pose[:3, 3], pose[:3, 3] + pose[:3, 2])
    return set_pivot_distance(
        replace(viewpoint, world_from_camera=level), viewpoint.pivot_distance * extract_scale(matrix)
    )


def _turn(pose: Float[ndarray, "4 4"], yaw: float, pitch: float) -> Float[ndarray, "4 4"]:
    cosine, sine = np.cos(yaw), np.sin(yaw)
    about_z = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
    rotation = about_z @ pose[:3, :3]
    cosine, sine = np.cos(pitch), np.sin(pitch)
    tilted = rotation @ np.array([[1, 0, 0], [0, cosine, -sine], [0, sine, cosine]])
    upright = tilted[2, 1] <= max(rotation[2, 1], 0.0)  # y points down: no drag turns the picture over the pole
    if upright and abs(tilted[2, 2]) <= max(STEEPEST, abs(rotation[2, 2])):
        rotation = tilted
    left, _, right = np.linalg.svd(rotation)  # so that many small turns do not shear the axes
    turned = pose.copy()
    turned[:3, :3] = left @ right
    return turned
