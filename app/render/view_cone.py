"""The part of space that a camera sees now, and may see soon, without splats being looked through again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.scene.camera import Camera, build_edge_normals

EDGE_PIXELS = 16.0
"""Pixels around the picture that count as seen: faint splats and dots reach so far at least."""
TURN = 0.08
"""By how much the slopes of a picture's edges are raised, so that a camera may turn: some 4° on each side."""
BACK = 1.0
"""Metres by which the cone begins behind the camera, so that it may move."""


@dataclass(frozen=True)
class ViewCone:
    """A pyramid without base: all points x with normals · (x - apex) ≥ 0."""

    apex: Float64[ndarray, "3"]
    """Metres."""
    normals: Float64[ndarray, "4 3"]
    """Unit inner normals of the sides."""

    def covers(self, camera: Camera) -> bool:
        """Whether all that a camera sees lies inside: its place and the rays through its picture's corners do."""
        rays = _list_corner_rays(camera)
        inside = self.normals @ (camera.position - self.apex) >= 0
        return bool(inside.all() and (rays @ self.normals.T >= 0).all())


def widen_view(camera: Camera) -> ViewCone:
    """Make a cone that covers a camera, and what it sees after a small move."""
    left, top, right, bottom = camera.find_edge_slopes(EDGE_PIXELS)
    normals = build_edge_normals(left - TURN, top - TURN, right + TURN, bottom + TURN)
    rotation = camera.world_from_camera[:3, :3]
    return ViewCone(camera.position - BACK * rotation[:, 2], normals @ rotation.T)


def _list_corner_rays(camera: Camera) -> Float64[ndarray, "4 3"]:
    """List the directions, in the world, of the picture's corners, `EDGE_PIXELS` farther out."""
    left, top, right, bottom = camera.find_edge_slopes(EDGE_PIXELS)
    rays = np.array([[x, y, 1.0] for x in (left, right) for y in (top, bottom)])
    return rays @ camera.world_from_camera[:3, :3].T
