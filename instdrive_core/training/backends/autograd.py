"""The CPU rasterizer and the harmonics as torch functions. Tensors and arrays share their memory."""

from __future__ import annotations

import numba
import numpy as np
import torch
from jaxtyping import Float, Float64
from numpy import ndarray
from torch import Tensor
from torch.autograd.function import once_differentiable

from instdrive_core.rasterize.kernels.layout import to_kernel_array
from instdrive_core.rasterize.kernels.view_colors import (
    build_harmonics_view,
    compute_colors_backward,
    compute_colors_in_view,
)
from instdrive_core.rasterize.render import RasterGradients, render, render_backward
from instdrive_core.scene.camera import Camera
from instdrive_core.training.backends.backend import Nodes, NodesOnDevice, SeenSplats


def rasterize(
    means: Float[Tensor, "v 3"],
    quats: Float[Tensor, "v 4"],
    log_scales: Float[Tensor, "v 3"],
    opacity_logits: Float[Tensor, " v"],
    channels: Float[Tensor, "v c"],
    camera: Camera,
    geometry_channels: int,
    seen: SeenSplats | None = None,
) -> tuple[Float[Tensor, "h w c"], Float[Tensor, "h w"], Float[Tensor, "h w"]]:
    """Differentiable `render`: image Σ w·channels, depth Σ w·z (not divided by alpha) and alpha, on the CPU.

    Args:
        geometry_channels: only depth, alpha and this many first channels send gradient into geometry and opacity.
        seen: filled by the backward pass.
    """
    return _Rasterize.apply(means, quats, log_scales, opacity_logits, channels, camera, geometry_channels, seen)


def evaluate_harmonics(
    means: Float[Tensor, "v 3"],
    sh_dc: Float[Tensor, "v 3"],
    sh_rest: Float[Tensor, "v k 3"],
    camera_position: Float64[ndarray, "3"],
    nodes: Nodes | None = None,
    poses: Float64[ndarray, "m 4 4"] | None = None,
) -> Float[Tensor, "v 3"]:
    """Differentiable `kernels.view_colors.compute_colors`; gradients reach `sh_dc` and `sh_rest`, not the means."""
    assert not isinstance(nodes, NodesOnDevice), "kernels take arrays"
    return _ViewColors.apply(means, sh_dc, sh_rest, camera_position, nodes, poses)


class _Rasterize(torch.autograd.Function):
    @staticmethod
    def forward(ctx, means, quats, log_scales, opacity_logits, channels, camera, geometry_channels, seen):
        ctx.save_for_backward(means, quats, log_scales, channels)  # so that torch notices changes in place
        ctx.opacities = np.empty(len(means), np.float32)
        _opacities(_array(opacity_logits), ctx.opacities)
        geometry = _array(means), _array(quats), _array(log_scales)
        raster = render(*geometry, ctx.opacities, _array(channels), camera)
        ctx.raster, ctx.geometry_channels, ctx.seen = raster.context, geometry_channels, seen
        return torch.from_numpy(raster.image), torch.from_numpy(raster.depth), torch.from_numpy(raster.alpha)

    @staticmethod
    @once_differentiable
    def backward(ctx, grad_image, grad_depth, grad_alpha):  # pyright: ignore[reportIncompatibleMethodOverride]
        _ = ctx.saved_tensors
        grads = _array(grad_image), _array(grad_depth), _array(grad_alpha)
        gradients = render_backward(ctx.raster, *grads, ctx.geometry_channels)
        grad_logits = np.empty_like(ctx.opacities)
        _logit_gradients(gradients.opacities, ctx.opacities, grad_logits)
        if ctx.seen is not None:
            _fill(ctx.seen, gradients, ctx.raster.camera)
        return (
            torch.from_numpy(gradients.means),
            torch.from_numpy(gradients.quats),
            torch.from_numpy(gradients.log_scales),
            torch.from_numpy(grad_logits),
            torch.from_numpy(gradients.channels),
            *(None, None, None),
        )


def _fill(seen: SeenSplats, gradients: RasterGradients, camera: Camera) -> None:
    """Screen-space gradients go from pixels to coordinates in [-1, 1]."""
    side = max(camera.width, camera.height)
    seen.visible = torch.from_numpy(gradients.visible)
    seen.gradients = torch.from_numpy(gradients.means2d_abs * np.float32(0.5 * side))


class _ViewColors(torch.autograd.Function):
    @staticmethod
    def forward(ctx, means, sh_dc, sh_rest, camera_position, nodes, poses):
        ctx.save_for_backward(means)  # the view refers to it
        ctx.view, ctx.rest_count = (
            build_harmonics_view(means.detach().numpy(), camera_position, nodes, poses),
            sh_rest.shape[1],
        )
        ctx.colors = compute_colors_in_view(ctx.view, _array(sh_dc), _array(sh_rest))
        return torch.from_numpy(ctx.colors)

    @staticmethod
    @once_differentiable
    def backward(ctx, grad_colors):  # pyright: ignore[reportIncompatibleMethodOverride]
        _ = ctx.saved_tensors
        grad_dc, grad_rest = compute_colors_backward(ctx.view, ctx.rest_count, ctx.colors, _array(grad_colors))
        return None, torch.from_numpy(grad_dc), torch.from_numpy(grad_rest), None, None, None


def _array(tensor: Tensor) -> ndarray:
    """A view of the tensor's memory, where the kernels can take it."""
    return to_kernel_array(tensor.detach().numpy())


@numba.njit(parallel=True, error_model="numpy", fastmath={"nsz", "arcp", "contract", "afn"}, cache=True)
def _opacities(logits, opacities):
    one = np.float32(1)
    for i in numba.prange(len(logits)):
        opacities[i] = one / (one + np.exp(-logits[i]))


@numba.njit(parallel=True, error_model="numpy", cache=True)
def _logit_gradients(by_opacity, opacities, by_logit):
    for i in numba.prange(len(by_logit)):
        by_logit[i] = by_opacity[i] * opacities[i] * (np.float32(1) - opacities[i])
