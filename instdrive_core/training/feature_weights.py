"""Instance features on frozen geometry: the rendered feature map is linear in them, F_pix = W F with W sparse."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int, UInt16
from numpy import ndarray
from torch import Tensor

from instdrive_core.maths.activations import sigmoid
from instdrive_core.rasterize.blend_weights import (
    BlendWeights,
    apply_weights,
    apply_weights_transposed,
    blend_weights,
)
from instdrive_core.scene.scene import placed
from instdrive_core.training.model import SceneModel
from instdrive_core.training.rows_in_view import rows_in_view
from instdrive_core.training.views import TrainingView


@dataclass(frozen=True)
class CachedView:
    """Sampled pixels of one view: who contributes how much, and which mask each belongs to."""

    weights: BlendWeights
    labels: UInt16[ndarray, " p"]


def cached_view(model: SceneModel, view: TrainingView, pixels: Int[ndarray, " p"], min_alpha: float) -> CachedView:
    """Blending weights of `pixels` (flat indices with a mask); those with less than `min_alpha` opacity are dropped."""
    assert view.labels is not None
    weights = _weights_of_view(model, view, pixels)
    counts = np.diff(weights.indptr)
    alpha = np.zeros(len(pixels))
    np.add.at(alpha, np.repeat(np.arange(len(pixels)), counts), weights.weights)
    kept = alpha >= min_alpha
    entries = np.repeat(kept, counts)
    indptr = np.concatenate([[0], np.cumsum(counts[kept])]).astype(np.int64)
    return CachedView(
        BlendWeights(indptr, weights.rows[entries], weights.weights[entries]), view.labels.ravel()[pixels[kept]]
    )


def _weights_of_view(model: SceneModel, view: TrainingView, pixels: Int[ndarray, " p"]) -> BlendWeights:
    poses = model.actor_poses.at(view.time, model.corrections)
    p = {name: value.detach().numpy() for name, value in model.parameters.items()}
    rows = rows_in_view(
        p["means"], p["log_scales"], p["opacity_logits"], model.nodes, poses.matrices, poses.present, view.camera
    )
    means, quats = placed(p["means"][rows], p["quats"][rows], model.nodes[rows], poses.matrices)
    opacities = sigmoid(p["opacity_logits"][rows])
    weights = blend_weights(means, quats, p["log_scales"][rows], opacities, view.camera, pixels)
    return BlendWeights(weights.indptr, rows[weights.rows].astype(weights.rows.dtype), weights.weights)


class _WeightedFeatures(torch.autograd.Function):
    @staticmethod
    def forward(ctx, features: Tensor, weights: BlendWeights) -> Tensor:
        ctx.weights, ctx.count = weights, len(features)
        return torch.from_numpy(apply_weights(weights, features.detach().numpy()))

    @staticmethod
    def backward(ctx, grad: Tensor) -> tuple[Tensor, None]:
        full = apply_weights_transposed(ctx.weights, grad.contiguous().numpy(), ctx.count)
        return torch.from_numpy(full), None


def weighted_features(features: Float[Tensor, "n d"], weights: BlendWeights) -> Float[Tensor, "p d"]:
    """W F and, backwards, its transpose."""
    return _WeightedFeatures.apply(features, weights)
