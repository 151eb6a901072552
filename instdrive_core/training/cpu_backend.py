"""The operations of a training step on the CPU's own kernels."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float, Float64, Int, UInt8, UInt16
from numpy import ndarray
from torch import Tensor

from instdrive_core.scene.camera import Camera
from instdrive_core.training import autograd, exposure_op, losses, photometric, placement, sky_blend
from instdrive_core.training.backend import SeenSplats


class CpuBackend:
    """`Backend` on Numba kernels. The same input gives the same bits, whatever the number of threads."""

    name = "cpu"
    device = torch.device("cpu")

    def rasterize(
        self,
        means: Float[Tensor, "v 3"],
        quats: Float[Tensor, "v 4"],
        log_scales: Float[Tensor, "v 3"],
        opacity_logits: Float[Tensor, " v"],
        channels: Float[Tensor, "v c"],
        camera: Camera,
        geometry_channels: int,
        seen: SeenSplats | None = None,
    ) -> tuple[Float[Tensor, "h w c"], Float[Tensor, "h w"], Float[Tensor, "h w"]]:
        """See `autograd.rasterize`."""
        return autograd.rasterize(means, quats, log_scales, opacity_logits, channels, camera, geometry_channels, seen)

    def sh_colors(
        self,
        means: Float[Tensor, "v 3"],
        sh_dc: Float[Tensor, "v 3"],
        sh_rest: Float[Tensor, "v k 3"],
        camera_position: Float64[ndarray, "3"],
        nodes: UInt16[ndarray, " v"] | None = None,
        poses: Float64[ndarray, "m 4 4"] | None = None,
    ) -> Float[Tensor, "v 3"]:
        """See `autograd.sh_colors`."""
        return autograd.sh_colors(means, sh_dc, sh_rest, camera_position, nodes, poses)

    def place(
        self,
        means: Float[Tensor, "v 3"],
        quats: Float[Tensor, "v 4"],
        nodes: UInt16[ndarray, " v"],
        rotations: Float[Tensor, "m 3 3"],
        shifts: Float[Tensor, "m 3"],
    ) -> tuple[Float[Tensor, "v 3"], Float[Tensor, "v 4"]]:
        """See `placement.place`; where all rows lie in the world, the tensors given come back."""
        return placement.place(means, quats, nodes, rotations, shifts)

    def over_sky(
        self,
        image: Float[Tensor, "h w 3"],
        alpha: Float[Tensor, "h w"],
        faces: Float[Tensor, "6 r r 3"],
        camera: Camera,
    ) -> Float[Tensor, "h w 3"]:
        """See `sky_blend.over_sky`."""
        return sky_blend.over_sky(image, alpha, faces, camera)

    def exposed(self, image: Float[Tensor, "h w 3"], exposure: Float[Tensor, "3 4"]) -> Float[Tensor, "h w 3"]:
        """See `exposure_op.exposed`."""
        return exposure_op.exposed(image, exposure)

    def photometric_loss(
        self,
        image: Float[Tensor, "h w 3"],
        target: UInt8[ndarray, "h w 3"],
        valid: Bool[ndarray, "h w"] | None,
        ssim_weight: float,
    ) -> tuple[Float[Tensor, ""], float]:
        """See `photometric.photometric_loss`."""
        return photometric.photometric_loss(image, target, valid, ssim_weight)

    def depth_loss(
        self,
        depth: Float[Tensor, "h w"],
        alpha: Float[Tensor, "h w"],
        pixels: Int[ndarray, " k"],
        lidar_depths: Float[ndarray, " k"],
    ) -> Float[Tensor, ""]:
        """See `losses.depth_loss`."""
        return losses.depth_loss(depth, alpha, pixels, lidar_depths)

    def sky_loss(self, alpha: Float[Tensor, "h w"], sky: Bool[ndarray, "h w"]) -> Float[Tensor, ""]:
        """See `losses.sky_loss`."""
        return losses.sky_loss(alpha, sky)
