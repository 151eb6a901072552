"""The operations of a training step on the CPU's own kernels."""

from __future__ import annotations

import torch

from instdrive_core.training.backends import autograd, exposure_op, losses, photometric, placement, sky_blend


class CpuBackend:
    """`Backend` on Numba kernels. The same input gives the same bits, whatever the number of threads."""

    name = "cpu"
    device = torch.device("cpu")
    uses_kernels = True

    rasterize = staticmethod(autograd.rasterize)
    evaluate_harmonics = staticmethod(autograd.evaluate_harmonics)
    place_gaussians = staticmethod(placement.place_gaussians)
    sum_rigid_gradient = staticmethod(placement.sum_rigid_gradient)
    composite_over_sky = staticmethod(sky_blend.composite_over_sky)
    expose = staticmethod(exposure_op.expose)
    photometric_loss = staticmethod(photometric.photometric_loss)
    depth_loss = staticmethod(losses.depth_loss)
    opacity_loss = staticmethod(losses.opacity_loss)
