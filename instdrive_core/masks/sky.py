"""Where a photo surely shows the sky: LiDAR looked there and nothing came back."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, UInt8
from numpy import ndarray
from scipy import ndimage

from instdrive_core.scene.camera import Camera

HIGHEST_BEAM = 15.0
"""Elevation in degrees above which the LiDAR is blind."""
MAX_GRADIENT = 10.0
"""Grey levels per pixel; what has more texture is something too far for the LiDAR."""
MIN_REACH = 0.01
"""Columns within this share of the image's width count as one: a beam does not hit each column."""


def sky_seeds(supported: Bool[ndarray, "h w"], image: UInt8[ndarray, "h w 3"], camera: Camera) -> Bool[ndarray, "h w"]:
    """Pixels that are surely sky.

    In each column, everything above the highest surface is empty if a higher beam of the LiDAR would have hit it;
    where the highest surface is near the upper end of the LiDAR's field of view, nothing is known.

    Args:
        supported: where a surface was met.
        image: the photo; textured pixels are left out.
        camera: its view.
    """
    elevation = np.degrees(np.arcsin(np.clip(camera.ray_directions()[..., 2], -1, 1)))
    reach = max(1, round(MIN_REACH * camera.width))
    wide = ndimage.maximum_filter1d(supported, 2 * reach + 1, axis=1)
    top = np.where(wide.any(axis=0), wide.argmax(axis=0), camera.height)
    highest = elevation[np.minimum(top, camera.height - 1), np.arange(camera.width)]
    highest = np.where(top < camera.height, highest, -90)
    next_beam = highest + 1.5 + 0.3 * np.maximum(highest, 0)
    empty = (elevation > np.maximum(next_beam, 1)) & (next_beam < HIGHEST_BEAM)
    return empty & (_gradient(image) < MAX_GRADIENT)


def _gradient(image: UInt8[ndarray, "h w 3"]) -> ndarray:
    """Largest difference to a neighbour in any channel, over a small neighbourhood."""
    values = image.astype(np.float32)
    spread = ndimage.maximum_filter(values, (3, 3, 1)) - ndimage.minimum_filter(values, (3, 3, 1))
    return spread.max(axis=2)
