"""Interface of a device that trains: the differentiable operations of a step, on the CPU's kernels or on gsplat."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Bool, Float, Float64, Int, Int64, UInt8, UInt16
from numpy import ndarray
from torch import Tensor

from instdrive_core.scene.camera import Camera


@dataclass
class SeenSplats:
    """Filled by the backward pass of one view: what densification and the optimiser ask for, one entry per splat given.

    All tensors lie on the backend's device.
    """

    visible: Bool[Tensor, " v"] | None = None
    """Whether the splat reaches a pixel."""
    gradients: Float[Tensor, " v"] | None = None
    """Length of (Σ|∂L/∂x|, Σ|∂L/∂y|) over pixels, for screen coordinates in [-1, 1] along the longer side (AbsGS)."""


@dataclass(frozen=True)
class NodesOnDevice:
    """Which node each of v rows lies in, rising, for a backend without kernels: nothing is read from its device."""

    of_rows: Int64[Tensor, " v"]
    """On the backend's device."""
    background: int
    """How many rows, the first ones, lie in node 0, the world."""


Nodes = UInt16[ndarray, " v"] | NodesOnDevice
"""Nodes of v rows: an array for the CPU's kernels; plain torch takes both."""


@runtime_checkable
class Backend(Protocol):
    """The operations of a training step. Tensors lie on `device`; results agree with `CpuBackend` within rounding."""

    name: str
    device: torch.device
    uses_kernels: bool
    """Whether the trainer's own steps beside these operations run on Numba's kernels too, which read the CPU's memory;
    else in plain torch, on any device."""

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
        """Image Σ w·channels, depth Σ w·z (neither divided by alpha) and alpha Σ w.

        Depth, alpha and the first `geometry_channels` channels send gradient into geometry and opacity.
        """
        ...

    def evaluate_harmonics(
        self,
        means: Float[Tensor, "v 3"],
        sh_dc: Float[Tensor, "v 3"],
        sh_rest: Float[Tensor, "v k 3"],
        camera_position: Float64[ndarray, "3"],
        nodes: Nodes | None = None,
        poses: Float64[ndarray, "m 4 4"] | None = None,
    ) -> Float[Tensor, "v 3"]:
        """Colours seen from a camera; actors' harmonics turn with their node. No gradient into the means."""
        ...

    def place_gaussians(
        self,
        means: Float[Tensor, "v 3"],
        quats: Float[Tensor, "v 4"],
        nodes: Nodes,
        rotations: Float[Tensor, "m 3 3"],
        shifts: Float[Tensor, "m 3"],
    ) -> tuple[Float[Tensor, "v 3"], Float[Tensor, "v 4"]]:
        """Means and quaternions in the world, given world_from_node of every node (node 0, the world, stays).

        Gradients reach means, quaternions, rotations (as nine free entries) and shifts; they are summed in fixed order.
        """
        ...

    def sum_rigid_gradient(
        self,
        means: Float[Tensor, "v 3"],
        quats: Float[Tensor, "v 4"],
        grad_means: Float[Tensor, "v 3"],
        grad_quats: Float[Tensor, "v 4"],
    ) -> tuple[Float64[ndarray, "3"], Float64[ndarray, "3"]]:
        """Gradient along a rigid motion of everything: a shift (per metre), and a turn about the origin (per radian).

        A camera that moves the opposite way sees the same. Sums are in fixed order.
        """
        ...

    def composite_over_sky(
        self,
        image: Float[Tensor, "h w 3"],
        alpha: Float[Tensor, "h w"],
        faces: Float[Tensor, "6 r r 3"],
        camera: Camera,
    ) -> Float[Tensor, "h w 3"]:
        """image + (1 - alpha) · sky(direction)."""
        ...

    def expose(self, image: Float[Tensor, "h w 3"], exposure: Float[Tensor, "3 4"]) -> Float[Tensor, "h w 3"]:
        """exposure[:, :3] · colour + exposure[:, 3] at every pixel."""
        ...

    def photometric_loss(
        self,
        image: Float[Tensor, "h w 3"],
        target: UInt8[ndarray, "h w 3"],
        valid: Bool[ndarray, "h w"] | None,
        ssim_weight: float,
    ) -> tuple[Float[Tensor, ""], Float[Tensor, ""] | float]:
        """(1 - w) L1 + w (1 - SSIM), and the PSNR in dB of the image clamped to [0, 1].

        The loss is averaged over the whole image, invalid pixels counting as equal; the PSNR is that of valid pixels,
        a tensor where a number would have to be waited for.
        """
        ...

    def depth_loss(
        self,
        depth: Float[Tensor, "h w"],
        alpha: Float[Tensor, "h w"],
        pixels: Int[ndarray, " k"],
        lidar_depths: Float[ndarray, " k"],
    ) -> Float[Tensor, ""]:
        """Mean |expected depth - LiDAR depth| in metres over the given flat pixels where alpha > 0.05; 0 if none."""
        ...

    def opacity_loss(self, alpha: Float[Tensor, "h w"], pixels: Bool[ndarray, "h w"], solid: bool) -> Float[Tensor, ""]:
        """Binary cross-entropy of alpha towards 1 (`solid`) or 0 in the given pixels, averaged over the whole image."""
        ...
