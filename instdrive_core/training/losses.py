"""Losses of the RGB stage: L1 + SSIM (3DGS), LiDAR depth, sky opacity."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

_WINDOW, _SIGMA = 11, 1.5


def _gaussian_window() -> Float[Tensor, " k"]:
    offsets = torch.arange(_WINDOW, dtype=torch.float32) - _WINDOW // 2
    window = torch.exp(-offsets.square() / (2 * _SIGMA**2))
    return window / window.sum()


def _blurred(stack: Float[Tensor, "c h w"], window: Float[Tensor, " k"]) -> Float[Tensor, "c h w"]:
    channels = len(stack)
    column = window[None, None, :, None].expand(channels, 1, -1, 1)
    row = window[None, None, None, :].expand(channels, 1, 1, -1)
    half = _WINDOW // 2
    blurred = torch.nn.functional.conv2d(stack[None], column, padding=(half, 0), groups=channels)
    return torch.nn.functional.conv2d(blurred, row, padding=(0, half), groups=channels)[0]


def ssim_map(image: Float[Tensor, "h w 3"], target: Float[Tensor, "h w 3"]) -> Float[Tensor, "3 h w"]:
    """SSIM per pixel and channel with an 11 x 11 Gaussian window (sigma 1.5) and zero padding, as in 3DGS."""
    x, y = image.permute(2, 0, 1), target.permute(2, 0, 1)
    moments = _blurred(torch.cat([x, y, x * x, y * y, x * y]), _gaussian_window())
    mean_x, mean_y, square_x, square_y, product = moments.split(3)
    variance_x, variance_y = square_x - mean_x * mean_x, square_y - mean_y * mean_y
    covariance = product - mean_x * mean_y
    c1, c2 = 0.01**2, 0.03**2
    return ((2 * mean_x * mean_y + c1) * (2 * covariance + c2)) / (
        (mean_x.square() + mean_y.square() + c1) * (variance_x + variance_y + c2)
    )


def photometric_loss(
    image: Float[Tensor, "h w 3"],
    target: Float[Tensor, "h w 3"],
    valid: Bool[Tensor, "h w"] | None,
    ssim_weight: float,
) -> Float[Tensor, ""]:
    """(1 - w) L1 + w (1 - SSIM) over valid pixels; the ego vehicle counts in neither term."""
    if valid is not None:
        image = torch.where(valid[..., None], image, target)
    l1 = (image - target).abs().mean()
    return (1 - ssim_weight) * l1 + ssim_weight * (1 - ssim_map(image, target).mean())


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
