"""The CPU rasterizer and the harmonics as torch functions. Tensors and arrays share their memory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Float32, Float64, Int64, UInt16
from numpy import ndarray
from torch import Tensor
from torch.autograd.function import once_differentiable

from instdrive_core.rasterize.render import RasterGradients, render, render_backward
from instdrive_core.rasterize.view_colors import view_colors, view_colors_backward
from instdrive_core.scene.camera import Camera


@dataclass
class SplatStatistics:
    """What densification asks for, gathered over the backward passes of many views."""

    grad_sum: Float32[ndarray, " n"]
    """Sum of the absolute screen-space gradients, for coordinates in [-1, 1] along the longer side of the image."""
    view_counts: Int64[ndarray, " n"]
    """In how many views each splat was visible."""
    max_radii: Float32[ndarray, " n"]
    """Largest radius (three standard deviations) in fractions of the longer side of the image."""

    @classmethod
    def empty(cls, count: int) -> SplatStatistics:
        """Nothing seen yet of `count` splats."""
        return cls(np.zeros(count, np.float32), np.zeros(count, np.int64), np.zeros(count, np.float32))

    def add(self, gradients: RasterGradients, camera: Camera) -> None:
        """Count one view in."""
        side = max(camera.width, camera.height)
        self.grad_sum += gradients.means2d_abs * np.float32(0.5 * side)
        self.view_counts += gradients.visible
        np.maximum(self.max_radii, gradients.radii / np.float32(side), out=self.max_radii)

    def mean_gradients(self) -> Float32[ndarray, " n"]:
        """Mean over the views that saw each splat; 0 for the unseen."""
        return self.grad_sum / np.maximum(self.view_counts, 1).astype(np.float32)


def rasterize(
    means: Float[Tensor, "n 3"],
    quats: Float[Tensor, "n 4"],
    log_scales: Float[Tensor, "n 3"],
    opacity_logits: Float[Tensor, " n"],
    channels: Float[Tensor, "n c"],
    camera: Camera,
    geometry_channels: int,
    statistics: SplatStatistics | None = None,
) -> tuple[Float[Tensor, "h w c"], Float[Tensor, "h w"], Float[Tensor, "h w"]]:
    """Differentiable `render`: image Σ w·channels, depth Σ w·z (not divided by alpha) and alpha, on the CPU.

    Args:
        geometry_channels: only depth, alpha and this many first channels send gradient into geometry and opacity.
        statistics: filled by the backward pass.
    """
    return _Rasterize.apply(means, quats, log_scales, opacity_logits, channels, camera, geometry_channels, statistics)


def sh_colors(
    means: Float[Tensor, "n 3"],
    sh_dc: Float[Tensor, "n 3"],
    sh_rest: Float[Tensor, "n k 3"],
    camera_position: Float64[ndarray, "3"],
    nodes: UInt16[ndarray, " n"] | None = None,
    poses: Float64[ndarray, "m 4 4"] | None = None,
) -> Float[Tensor, "n 3"]:
    """Differentiable `view_colors`; gradients reach `sh_dc` and `sh_rest`, not the means."""
    return _ViewColors.apply(means, sh_dc, sh_rest, camera_position, nodes, poses)


class _Rasterize(torch.autograd.Function):
    @staticmethod
    def forward(ctx, means, quats, log_scales, opacity_logits, channels, camera, geometry_channels, statistics):
        opacities = torch.sigmoid(opacity_logits)
        raster = render(_array(means), _array(quats), _array(log_scales), _array(opacities), _array(channels), camera)
        ctx.save_for_backward(means, quats, log_scales, channels, opacities)  # so that torch notices changes in place
        ctx.raster, ctx.camera = raster.context, camera
        ctx.geometry_channels, ctx.statistics = geometry_channels, statistics
        return torch.from_numpy(raster.image), torch.from_numpy(raster.depth), torch.from_numpy(raster.alpha)

    @staticmethod
    @once_differentiable
    def backward(ctx, grad_image, grad_depth, grad_alpha):
        *_, opacities = ctx.saved_tensors
        grads = _array(grad_image), _array(grad_depth), _array(grad_alpha)
        gradients = render_backward(ctx.raster, grads[0], grads[1], grads[2], ctx.geometry_channels)
        if ctx.statistics is not None:
            ctx.statistics.add(gradients, ctx.camera)
        grad_logits = torch.from_numpy(gradients.opacities) * opacities * (1 - opacities)
        return (
            torch.from_numpy(gradients.means),
            torch.from_numpy(gradients.quats),
            torch.from_numpy(gradients.log_scales),
            grad_logits,
            torch.from_numpy(gradients.channels),
            *(None, None, None),
        )


class _ViewColors(torch.autograd.Function):
    @staticmethod
    def forward(ctx, means, sh_dc, sh_rest, camera_position, nodes, poses):
        ctx.save_for_backward(means, sh_dc, sh_rest)
        ctx.view = (camera_position, nodes, poses)
        return torch.from_numpy(
            view_colors(_array(means), _array(sh_dc), _array(sh_rest), camera_position, nodes, poses)
        )

    @staticmethod
    @once_differentiable
    def backward(ctx, grad_colors):
        means, sh_dc, sh_rest = (_array(tensor) for tensor in ctx.saved_tensors)
        position, nodes, poses = ctx.view
        grad_dc, grad_rest = view_colors_backward(means, sh_dc, sh_rest, position, nodes, poses, _array(grad_colors))
        return None, torch.from_numpy(grad_dc), torch.from_numpy(grad_rest), None, None, None


def _array(tensor: Tensor) -> ndarray:
    """A view of the tensor's memory."""
    return tensor.detach().numpy()
