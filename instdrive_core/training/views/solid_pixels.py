"""Pixels of a photo that show something solid: no mask of any source shows the sky."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, UInt16
from numpy import ndarray

from instdrive_core.masks.image.sky import LOWEST_SKY
from instdrive_core.scene.camera import Camera


def find_solid_pixels(
    layers: Sequence[UInt16[ndarray, "h w"]], sky: Bool[ndarray, "h w"], camera: Camera, knows_sky: bool
) -> Bool[ndarray, "h w"]:
    """Find the pixels in masks and not in the sky.

    Args:
        layers: label maps of the photo's masks, 0 = none.
        sky: the sky as far as it was found.
        camera: where the photo was taken from, z up.
        knows_sky: LiDAR told where the sky is. Otherwise it was found by its looks, and a mask that lies above the
            horizon altogether may be a cloud.
    """
    solid = np.zeros(sky.shape, bool)
    below = None if knows_sky else camera.compute_ray_directions()[..., 2] <= np.sin(np.radians(LOWEST_SKY))
    for labels in layers:
        stands = np.ones(int(labels.max(initial=0)) + 1, bool)
        if below is not None:
            stands[:] = False
            stands[labels[below]] = True
        stands[0] = False
        solid |= stands[labels]
    return solid & ~sky
