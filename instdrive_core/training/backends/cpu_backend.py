"""The operations of a training step on the CPU's own kernels."""

from __future__ import annotations

import torch

from instdrive_core.training.backends import autograd, exposure_op, losses, photometric, placement, sky_blend


class CpuBackend:
    """`Backend` on Numba kernels. The same input gives the same bits, whatever the number of threads."""

    name = "cpu"
    device = torch.device("cpu")

    rasterize = staticmethod(autograd.rasterize)
    sh_colors = staticmethod(autograd.evaluate_harmonics)
    place = staticmethod(placement.place_gaussians)
    over_sky = staticmethod(sky_blend.over_sky)
    exposed = staticmethod(exposure_op.exposed)
    photometric_loss = staticmethod(photometric.photometric_loss)
    depth_loss = staticmethod(losses.depth_loss)
    sky_loss = staticmethod(losses.sky_loss)
