"""Where a photo would show the ground if nothing stood on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float64
from numpy import ndarray

from instdrive_core.scene.camera import Camera

LEVEL = 0.25
"""Metres above the plane up to which something is ground, kerbs included."""


@dataclass(frozen=True)
class GroundInPhoto:
    """The ground plane as the pixels of one photo meet it."""

    distances: Float64[ndarray, "h w"]
    """Metres along the viewing axis; infinite where a pixel looks past it."""
    sinking: Float64[ndarray, "h w"]
    """Metres by which a pixel's ray comes nearer to the plane per metre along the viewing axis."""

    def find_level_pixels(self, distances: Float[ndarray, "h w"]) -> Bool[ndarray, "h w"]:
        """Which pixels show ground, if they show something at these distances (metres along the viewing axis)."""
        heights = (self.distances - distances) * self.sinking
        return np.isfinite(self.distances) & (heights <= LEVEL)


def project_ground(camera: Camera, plane: tuple[float, float, float]) -> GroundInPhoto:
    """Find where the pixels of a photo meet the ground: height at the world's origin (metres), slopes along x and y."""
    normal = np.array([-plane[1], -plane[2], 1.0])
    rows, columns = np.mgrid[: camera.height, : camera.width] + 0.5
    rays = np.stack([(columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy, np.ones_like(rows)], axis=-1)
    sinking = -rays @ camera.world_from_camera[:3, :3].T @ normal
    height = float(camera.position @ normal) - plane[0]
    distances = np.where(sinking > 1e-6, height / np.maximum(sinking, 1e-6), np.inf)
    return GroundInPhoto(np.where(height > 0, distances, np.inf), sinking)
