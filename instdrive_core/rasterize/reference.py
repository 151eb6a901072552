"""The rasterizer's readable truth: plain numpy in float64, every splat at every pixel. For small scenes only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray

from instdrive_core.maths.rotations import matrix_from_quaternion
from instdrive_core.rasterize.kernels.settings import DEFAULT_SETTINGS, RasterSettings
from instdrive_core.scene.camera import Camera


@dataclass(frozen=True)
class Fragments:
    """V splats, nearest first, at every pixel."""

    rows: Int64[ndarray, " v"]
    depths: Float64[ndarray, " v"]
    raw_alphas: Float64[ndarray, "v h w"]
    """opacity · exp(-½ dᵀ·Σ⁻¹·d), neither clamped nor skipped."""


def evaluate_fragments(
    means: ndarray,
    quats: ndarray,
    log_scales: ndarray,
    opacities: ndarray,
    camera: Camera,
    settings: RasterSettings = DEFAULT_SETTINGS,
) -> Fragments:
    """Project by EWA splatting and evaluate every splat in front of the near plane at every pixel centre."""
    view = camera.camera_from_world
    points = means.astype(np.float64) @ view[:3, :3].T + view[:3, 3]
    rows = np.flatnonzero(points[:, 2] > settings.near)
    rows = rows[np.argsort(points[rows, 2], kind="stable")]
    x, y, z = points[rows].T

    low_x, low_y = -camera.cx / camera.fx, -camera.cy / camera.fy
    wide_x, wide_y = camera.width / camera.fx, camera.height / camera.fy
    slope_x = np.clip(x / z, low_x - 0.15 * wide_x, low_x + 1.15 * wide_x)
    slope_y = np.clip(y / z, low_y - 0.15 * wide_y, low_y + 1.15 * wide_y)
    jacobian = np.zeros((len(rows), 2, 3))
    jacobian[:, 0, 0], jacobian[:, 0, 2] = camera.fx / z, -camera.fx * slope_x / z
    jacobian[:, 1, 1], jacobian[:, 1, 2] = camera.fy / z, -camera.fy * slope_y / z

    axes = matrix_from_quaternion(quats[rows].astype(np.float64)) * np.exp(log_scales[rows].astype(np.float64))[:, None]
    flat = jacobian @ view[:3, :3] @ axes
    sharp = flat @ flat.transpose(0, 2, 1)
    widened = sharp + settings.low_pass * np.eye(2)
    conics = np.linalg.inv(widened)
    drawn = opacities[rows].astype(np.float64)
    if settings.antialiased:
        drawn = drawn * np.sqrt(np.maximum(np.linalg.det(sharp), 0) / np.linalg.det(widened))

    centers = np.stack([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy], axis=-1)
    pixels = np.stack(np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5), axis=-1)
    offsets = pixels - centers[:, None, None]
    powers = 0.5 * np.einsum("vhwi,vij,vhwj->vhw", offsets, conics, offsets)
    return Fragments(rows, z, drawn[:, None, None] * np.exp(-powers))


def find_blended_fragments(found: Fragments, settings: RasterSettings = DEFAULT_SETTINGS) -> Bool[ndarray, "v h w"]:
    """Find the fragments that are blended: bright enough, and not behind the one that would have finished the pixel."""
    alphas = np.minimum(found.raw_alphas, settings.max_alpha)
    bright = found.raw_alphas >= settings.min_alpha
    alive = np.ones(alphas.shape[1:], bool)
    transmittance = np.ones(alphas.shape[1:])
    result = np.zeros(alphas.shape, bool)
    for v in range(len(alphas)):
        after = transmittance * (1 - np.where(bright[v], alphas[v], 0))
        alive = alive & (after > settings.min_transmittance)
        result[v] = alive & bright[v]
        transmittance = np.where(alive, after, transmittance)
    return result


def compute_fragment_weights(
    found: Fragments, blended: Bool[ndarray, "v h w"], settings: RasterSettings = DEFAULT_SETTINGS
) -> Float64[ndarray, "v h w"]:
    """Compute w = α′ · Π (1 - α′) over the nearer fragments, for a given choice of which are blended."""
    alphas = np.where(blended, np.minimum(found.raw_alphas, settings.max_alpha), 0)
    passed = np.cumprod(1 - alphas, axis=0)
    return alphas * np.concatenate([np.ones((1, *alphas.shape[1:])), passed[:-1]])


def render_reference(
    means: ndarray,
    quats: ndarray,
    log_scales: ndarray,
    opacities: ndarray,
    channels: ndarray,
    camera: Camera,
    settings: RasterSettings = DEFAULT_SETTINGS,
) -> tuple[Float64[ndarray, "h w c"], Float64[ndarray, "h w"], Float64[ndarray, "h w"]]:
    """Render image, depth and alpha as `render` defines them."""
    found = evaluate_fragments(means, quats, log_scales, opacities, camera, settings)
    return sum_fragments(
        found, compute_fragment_weights(found, find_blended_fragments(found, settings), settings), channels
    )


def sum_fragments(
    found: Fragments, weight: Float64[ndarray, "v h w"], channels: ndarray
) -> tuple[Float64[ndarray, "h w c"], Float64[ndarray, "h w"], Float64[ndarray, "h w"]]:
    """Sum fragments to image Σ w·channels, depth Σ w·z and alpha Σ w."""
    image = np.einsum("vhw,vc->hwc", weight, channels[found.rows].astype(np.float64))
    return image, np.einsum("vhw,v->hw", weight, found.depths), weight.sum(axis=0)
