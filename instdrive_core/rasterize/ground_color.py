"""The usual colour of the ground around the cameras of a scene."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64
from numpy import ndarray
from scipy.spatial import KDTree

from instdrive_core.maths.rotations import normalize_quaternions
from instdrive_core.maths.spherical_harmonics import color_from_dc
from instdrive_core.maths.splat_axes import compute_normals
from instdrive_core.scene.scene import Scene

NEAR, BELOW = 12.0, 0.8
"""Metres from the nearest camera, level, and at least below it, at which ground is looked for."""
UPRIGHT = 0.9
"""Vertical part of the shortest axis of a splat from which on it lies flat."""
SOLID_LOGIT = 0.0
"""Logit of the opacity from which on a splat is solid."""
FEWEST = 200
"""Splats that make up a colour."""


def find_ground_color(scene: Scene) -> Float64[ndarray, "3"] | None:
    """Find the median colour, 0 … 1, of solid splats that lie flat below the cameras of a scene whose z points up.

    Returns None where there are too few.
    """
    if not scene.views:
        return None
    eyes = np.array([view.camera.world_from_camera[:3, 3] for view in scene.views])
    gaussians = scene.gaussians
    whole = np.isfinite(gaussians.means).all(axis=1) & np.isfinite(gaussians.log_scales).all(axis=1)
    whole &= np.isfinite(gaussians.quats).all(axis=1) & np.isfinite(gaussians.sh_dc).all(axis=1)
    rows = np.flatnonzero((scene.nodes == 0) & (gaussians.opacity_logits >= SOLID_LOGIT) & whole)
    means = gaussians.means[rows]
    away, nearest = KDTree(eyes[:, :2]).query(means[:, :2], distance_upper_bound=NEAR)
    near = np.flatnonzero(np.isfinite(away))
    rows = rows[near[means[near, 2] < eyes[np.asarray(nearest)[near], 2] - BELOW]]
    normals = compute_normals(normalize_quaternions(gaussians.quats[rows]), gaussians.log_scales[rows])
    rows = rows[np.abs(normals[:, 2]) >= UPRIGHT]
    if len(rows) < FEWEST:
        return None
    return np.median(color_from_dc(gaussians.sh_dc[rows]), axis=0).clip(0, 1).astype(np.float64)
