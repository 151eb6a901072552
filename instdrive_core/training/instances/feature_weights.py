"""Instance features on frozen geometry: the rendered feature map is linear in them, F_pix = W F with W sparse."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int64, Integer
from numpy import ndarray
from torch import Tensor

from instdrive_core.maths.activations import sigmoid
from instdrive_core.rasterize.kernels.blend_weights import (
    BlendWeights,
    apply_weights,
    compact_weights,
    compute_blend_weights,
    transpose_weights,
)
from instdrive_core.scene.scene import place_in_world
from instdrive_core.training.backends.row_gather import gather_rows
from instdrive_core.training.gaussians.model import SceneModel
from instdrive_core.training.gaussians.rows_in_view import find_rows_in_view
from instdrive_core.training.instances.instance_losses import Segments, segments_from_labels
from instdrive_core.training.views.training_view import TrainingView


@dataclass(frozen=True)
class CachedView:
    """Sampled pixels of one view: who contributes how much, and which mask each belongs to."""

    number: int
    """Number of the view in its store."""
    pixels: Int64[ndarray, " p"]
    """Flat indices into the view's image, rising; all of them in a mask."""
    rows: Int64[Tensor, " v"]
    """The Gaussians that the pixels show, rising; `weights` counts these alone."""
    weights: BlendWeights
    """W of these pixels and Gaussians, P × V."""
    transposed: BlendWeights
    """Wᵀ."""
    segments: Segments


def cache_view(
    model: SceneModel, view: TrainingView, number: int, pixels: Integer[ndarray, " p"], min_alpha: float
) -> CachedView:
    """Cache the blending weights of `pixels` (flat indices with a mask); those below `min_alpha` are dropped."""
    assert view.labels is not None
    rows, weights = compute_view_weights(model, view, pixels)
    alpha = apply_weights(weights, np.ones((len(rows), 1), np.float32))[:, 0]
    weights, kept = weights.select_pixels(alpha >= min_alpha), pixels[alpha >= min_alpha]
    used, weights = compact_weights(weights, len(rows))
    return CachedView(
        number,
        kept.astype(np.int64),
        torch.from_numpy(rows[used]),
        weights,
        transpose_weights(weights, len(used)),
        segments_from_labels(view.labels.ravel()[kept]),
    )


def compute_view_weights(
    model: SceneModel, view: TrainingView, pixels: Integer[ndarray, " p"]
) -> tuple[Int64[ndarray, " v"], BlendWeights]:
    """Compute the blending weights of pixels (flat indices), and the rows of the Gaussians that they count."""
    rows, placed_gaussians = place_gaussians_in_view(model, view)
    return rows, compute_blend_weights(*placed_gaussians, view.camera, pixels)


def place_gaussians_in_view(
    model: SceneModel, view: TrainingView
) -> tuple[Int64[ndarray, " v"], tuple[ndarray, ndarray, ndarray, ndarray]]:
    """Place the Gaussians that a view may show in the world.

    Returns their rows, then means, quaternions, log scales and opacities.
    """
    poses = model.actor_poses.at(view.time, model.corrections, view.camera.lag)
    p = {name: model.parameters[name].detach().numpy() for name in ("means", "quats", "log_scales", "opacity_logits")}
    rows = find_rows_in_view(
        p["means"], p["log_scales"], p["opacity_logits"], model.nodes, poses.matrices, poses.present, view.camera
    )
    chosen = torch.from_numpy(rows)
    means, quats, log_scales = (
        gather_rows(model.parameters[n], chosen).numpy() for n in ("means", "quats", "log_scales")
    )
    means, quats = place_in_world(means, quats, model.nodes[rows], poses.matrices)
    return rows, (means, quats, log_scales, sigmoid(p["opacity_logits"][rows]))


class _WeightedFeatures(torch.autograd.Function):
    @staticmethod
    def forward(ctx, features: Tensor, view: CachedView) -> Tensor:
        ctx.transposed = view.transposed
        return torch.from_numpy(apply_weights(view.weights, features.detach().numpy()))

    @staticmethod
    def backward(ctx, grad: Tensor) -> tuple[Tensor, None]:  # pyright: ignore[reportIncompatibleMethodOverride]
        return torch.from_numpy(apply_weights(ctx.transposed, grad.numpy())), None


def blend_features(features: Float[Tensor, "v d"], view: CachedView) -> Float[Tensor, "p d"]:
    """Blend the features of `view.rows` at the view's pixels: W F and, backwards, its transpose."""
    return _WeightedFeatures.apply(features, view)
