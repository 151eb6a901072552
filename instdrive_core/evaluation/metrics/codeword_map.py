"""The paper's predicted map: the nearest code of the rendered feature."""

from __future__ import annotations

import numpy as np
from jaxtyping import UInt64
from numpy import ndarray

from instdrive_core.evaluation.metrics.world_gaussians import WorldGaussians
from instdrive_core.instances.codebook import quantize_features
from instdrive_core.rasterize.render import render
from instdrive_core.scene.camera import Camera

MIN_ALPHA = 0.5
"""Pixels with less accumulated opacity show no codeword."""


def render_codeword_map(world: WorldGaussians, features: ndarray, camera: Camera) -> UInt64[ndarray, "h w"]:
    """Codeword + 1 of each pixel (0 is a codeword, too), 0 = none. 64 bits, since there are up to 2^32 codewords."""
    raster = render(world.means, world.quats, world.log_scales, world.opacities, features, camera)
    codes = quantize_features(raster.image).astype(np.uint64) + np.uint64(1)
    return np.where(raster.alpha >= MIN_ALPHA, codes, np.uint64(0))
