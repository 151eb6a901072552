"""Contributors of one pixel of a frame, found without drawing it."""

from __future__ import annotations

import numpy as np

from instdrive_core.rasterize.kernels.settings import DEFAULT_SETTINGS, RasterSettings
from instdrive_core.rasterize.pixel_contributors import Contributors, find_fragments_among, find_rows_near_pixel
from instdrive_core.scene.camera import Camera


def find_pixel_contributors(
    means: np.ndarray,
    quats: np.ndarray,
    log_scales: np.ndarray,
    opacities: np.ndarray,
    camera: Camera,
    x: int,
    y: int,
    settings: RasterSettings = DEFAULT_SETTINGS,
) -> Contributors:
    """Find what `render` blends at pixel (column x, row y). Raises ValueError where the pixel is outside the image."""
    near = find_rows_near_pixel(means, log_scales, opacities, camera, x, y, settings)
    shape = means[near], quats[near], log_scales[near], opacities[near]
    return find_fragments_among(near, *shape, camera, x, y, settings).blended
