"""The RGB stage's other terms: LiDAR depth and sky opacity, and the PSNR that progress shows."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor


def depth_loss(
    depth: Float[Tensor, "h w"], alpha: Float[Tensor, "h w"], lidar_depth: Float[Tensor, "h w"]
) -> Float[Tensor, ""]:
    """Mean |expected depth - LiDAR depth| in metres where LiDAR has one (> 0) and something is drawn."""
    known = (lidar_depth > 0) & (alpha.detach() > 0.05)
    if not bool(known.any()):
        return torch.zeros(())
    expected = depth[known] / alpha[known]
    return (expected - lidar_depth[known]).abs().mean()


def sky_loss(alpha: Float[Tensor, "h w"], sky: Bool[Tensor, "h w"]) -> Float[Tensor, ""]:
    """Binary cross-entropy of the accumulated opacity towards 0 inside the sky mask, averaged over the image."""
    if not bool(sky.any()):
        return torch.zeros(())
    return -torch.log((1 - alpha[sky]).clamp_min(1e-4)).sum() / alpha.numel()


def psnr(image: Float[Tensor, "h w 3"], target: Float[Tensor, "h w 3"], valid: Bool[Tensor, "h w"] | None) -> float:
    """Peak signal-to-noise ratio in dB over valid pixels, image clamped to [0, 1]."""
    squared = (image.detach().clamp(0, 1) - target).square()
    if valid is not None:
        squared = squared[valid]
    return float(-10 * torch.log10(squared.mean().clamp_min(1e-10)))
