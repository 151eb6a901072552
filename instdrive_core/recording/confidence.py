"""How far a recorded picture can be trusted: the share of its weight from splats that at least two photos saw."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float32, Int32
from numpy import ndarray

from instdrive_core.progress import report
from instdrive_core.rasterize.kernels.settings import choose_raster_settings
from instdrive_core.rasterize.preview import render_preview
from instdrive_core.rasterize.render import render, render_backward
from instdrive_core.scene.camera import CameraView
from instdrive_core.scene.scene import Scene, place_in_world

PHOTOS = 2
"""Photos that must have seen a splat for it to be trusted."""
SMALL_WIDTH = 240
"""Pixels: pictures this wide say well enough what a photo saw."""
LEAST_WEIGHT = 0.25
"""Summed blending weight, in pixels of the small picture, from which a photo saw a splat."""


@dataclass(frozen=True)
class ConfidenceFacts:
    """What a confidence map says in short."""

    mean: float
    """Mean over the covered pixels, 0 … 1; 0 where nothing is covered."""
    trusted: float
    """Share of the covered pixels with at least a half."""


def count_seeing_photos(scene: Scene, views: Sequence[CameraView]) -> Int32[ndarray, " n"]:
    """Count the views in which each splat has a part of the picture, each at its own time; reports progress."""
    counts = np.zeros(len(scene), np.int32)
    settings = replace(choose_raster_settings(scene), antialiased=False)
    gaussians = scene.gaussians
    nothing = np.zeros((len(scene), 1), np.float32)
    for place, view in enumerate(views):
        report(place / len(views))
        camera = view.camera.scale(min(1.0, SMALL_WIDTH / view.camera.width))
        poses, present = scene.find_node_poses(view.time, view.camera.lag)
        means, quats = place_in_world(gaussians.means, gaussians.quats, scene.nodes, poses)
        opacities = np.where(present[scene.nodes], gaussians.opacities, np.float32(0))
        shown = render(means, quats, gaussians.log_scales, opacities, nothing, camera, settings)
        ones, zeros = np.ones((*shown.alpha.shape, 1), np.float32), np.zeros_like(shown.alpha)
        # The gradient of the sum of a blended channel is the sum of the blending weights.
        weights = render_backward(shown.context, ones, zeros, zeros, 0).channels[:, 0]
        counts += weights >= LEAST_WEIGHT
    return counts


def draw_confidence(scene: Scene, view: CameraView, trusted: Bool[ndarray, " n"]) -> Float32[ndarray, "h w"]:
    """Draw the share of each pixel's weight that comes from `trusted` splats; 0 where no splat is."""
    gaussians = scene.gaussians
    poses, present = scene.find_node_poses(view.time, view.camera.lag)
    means, quats = place_in_world(gaussians.means, gaussians.quats, scene.nodes, poses)
    opacities = np.where(present[scene.nodes], gaussians.opacities, np.float32(0))
    colors = np.repeat(trusted.astype(np.float32)[:, None], 3, axis=1)
    settings = choose_raster_settings(scene)
    shown = render_preview(means, quats, gaussians.log_scales, opacities, colors, view.camera, settings)
    return np.where(shown.alpha > 0, shown.color[..., 0] / np.maximum(shown.alpha, 1e-6), 0).astype(np.float32)


def summarize_confidence(confidence: Float32[ndarray, "h w"], covered: Bool[ndarray, "h w"]) -> ConfidenceFacts:
    """Summarize a map over the pixels that splats cover."""
    if not covered.any():
        return ConfidenceFacts(0.0, 0.0)
    inside = np.clip(confidence[covered], 0, 1)
    return ConfidenceFacts(round(float(inside.mean()), 4), round(float((inside >= 0.5).mean()), 4))
