"""Gaussians of a scene in the world at one time, ready for the rasterizer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from instdrive_core.scene.camera import PhotoLag
from instdrive_core.scene.scene import Scene, place_in_world


@dataclass(frozen=True)
class WorldGaussians:
    """One row per row of the scene; a Gaussian that is not there has opacity 0."""

    means: Float32[ndarray, "n 3"]
    quats: Float32[ndarray, "n 4"]
    log_scales: Float32[ndarray, "n 3"]
    opacities: Float32[ndarray, " n"]


def place_world_gaussians(scene: Scene, time: float, lag: PhotoLag | None = None) -> WorldGaussians:
    """Place every actor at `time` (seconds), as a photo with this `lag` shows it.

    Actors whose track does not cover it are absent.
    """
    poses, present = scene.find_node_poses(time, lag)
    means, quats = place_in_world(scene.gaussians.means, scene.gaussians.quats, scene.nodes, poses)
    there = present[scene.nodes] > 0
    opacities = np.where(there, scene.gaussians.opacities, np.float32(0))
    return WorldGaussians(means, quats, scene.gaussians.log_scales, opacities)
