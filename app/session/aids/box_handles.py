"""Handles of a box: where they are in a picture, and what dragging one makes of the box.

Pure functions. A handle is named by its axis and side (``x-`` … ``z+``), or ``center``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Float64
from numpy import ndarray

from instdrive_app.session.selection_box import Box
from instdrive_core.scene.camera import Camera

CENTER = "center"
FACES = ("x-", "x+", "y-", "y+", "z-", "z+")
NEAREST = 0.1
"""Metres before the camera from which on handles are shown."""
THINNEST = 0.05
"""Metres that a side of the box has at least."""
STEEP = 0.25
"""Vertical part of the viewing ray from which on the middle is dragged over the ground instead of across the view."""

Point = tuple[float, float]


def find_inside(box: Box, points: Float[ndarray, "n 3"]) -> Bool[ndarray, " n"]:
    """Find the points (metres) inside a box."""
    axes, center = box.axes.astype(np.float32), box.center.astype(np.float32)
    half = (box.size / 2).astype(np.float32)
    inside = np.ones(len(points), np.bool_)
    offsets = points - center
    for axis in range(3):
        inside &= np.abs(offsets @ axes[:, axis]) <= half[axis]
    return inside


def locate_handles(box: Box, camera: Camera) -> dict[str, Point]:
    """Compute the pixels of the handles that lie before the camera."""
    places = np.stack([box.center, *(_find_face(box, name) for name in FACES)])
    pixels, depths = camera.project(places)
    names = (CENTER, *FACES)
    return {
        name: (float(x), float(y)) for name, (x, y), depth in zip(names, pixels, depths, strict=True) if depth > NEAREST
    }


def find_handle(box: Box, camera: Camera, at: Point, reach: float) -> str | None:
    """Find the handle nearest to a pixel, within `reach` pixels; a face comes before the middle behind it."""
    distances = {
        name: float(np.hypot(x - at[0], y - at[1])) + (name == CENTER) * 0.5
        for name, (x, y) in locate_handles(box, camera).items()
    }
    name = min(distances, key=distances.__getitem__, default=None)
    return name if name is not None and distances[name] <= reach else None


def drag_handle(box: Box, handle: str, camera: Camera, start: Point, to: Point) -> Box:
    """Drag a handle from one pixel to another: a face along its axis, the middle over the ground or across the view."""
    first, second = (_find_direction(camera, at) for at in (start, to))
    if handle == CENTER:
        return replace(box, center=box.center + _shift_in_plane(box.center, camera, first, second))
    axis, side = "xyz".index(handle[0]), 1.0 if handle[1] == "+" else -1.0
    direction, face = side * box.axes[:, axis], _find_face(box, handle)
    along = _find_nearest_along(face, direction, camera.position, second)
    along -= _find_nearest_along(face, direction, camera.position, first)
    grown = max(float(box.size[axis]) + along, THINNEST)
    size = box.size.copy()
    center = box.center + direction * (grown - float(size[axis])) / 2
    size[axis] = grown
    return Box(center, box.axes, size)


def turn_box(box: Box, degrees: float) -> Box:
    """Turn a box about the vertical through its middle."""
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    about_z = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    return replace(box, axes=about_z @ box.axes)


def _find_face(box: Box, name: str) -> Float64[ndarray, "3"]:
    axis, side = "xyz".index(name[0]), 1.0 if name[1] == "+" else -1.0
    return box.center + side * box.axes[:, axis] * box.size[axis] / 2


def _find_direction(camera: Camera, at: Point) -> Float64[ndarray, "3"]:
    """Unit vector in the world through a pixel."""
    local = np.array([(at[0] - camera.cx) / camera.fx, (at[1] - camera.cy) / camera.fy, 1.0])
    direction = camera.world_from_camera[:3, :3] @ local
    return direction / np.linalg.norm(direction)


def _find_nearest_along(
    point: Float64[ndarray, "3"],
    direction: Float64[ndarray, "3"],
    eye: Float64[ndarray, "3"],
    ray: Float64[ndarray, "3"],
) -> float:
    """Metres along a line from `point` to where a ray from the eye comes nearest to it; 0 where they are parallel."""
    between, slant = point - eye, float(direction @ ray)
    steep = 1.0 - slant * slant
    if steep < 1e-4:
        return 0.0
    return float((slant * (between @ ray) - between @ direction) / steep)


def _shift_in_plane(
    center: Float64[ndarray, "3"], camera: Camera, first: Float64[ndarray, "3"], second: Float64[ndarray, "3"]
) -> Float64[ndarray, "3"]:
    """Shift from where one ray meets the plane through `center` to where another does; none where one misses it."""
    level = min(abs(first[2]), abs(second[2])) > STEEP
    normal = np.array([0.0, 0.0, 1.0]) if level else camera.world_from_camera[:3, 2]
    height = float((center - camera.position) @ normal)
    lengths = [height / float(ray @ normal) if abs(ray @ normal) > 1e-6 else -1.0 for ray in (first, second)]
    if min(lengths) <= 0:
        return np.zeros(3)
    return second * lengths[1] - first * lengths[0]
