"""The weighted instance losses of one step, whichever schedule they run in."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float, Float32, UInt16
from numpy import ndarray
from torch import Tensor

from instdrive_core.training.instances import instance_losses as inst
from instdrive_core.training.instances.voxel_loss import voxel_loss
from instdrive_core.training.instances.voxels import group_by_voxel
from instdrive_core.training.settings.config import InstanceConfig


def compute_pixel_terms(
    features: Float[Tensor, "p d"], segments: inst.Segments, config: InstanceConfig, pseudo: bool
) -> dict[str, Tensor]:
    """Contrastive terms and, where `pseudo` is on, pseudo supervision of rendered features with their masks."""
    if not segments.count:
        return {}
    seen = activate_features(features, config)
    pull, push = inst.contrastive_loss(seen, segments, config.repulsion_offset)
    terms = {"pull": config.contrastive_weight * pull, "push": config.contrastive_weight * push}
    if config.pseudo_weight and pseudo:
        terms["pseudo"] = config.pseudo_weight * inst.pseudo_loss(seen, segments)
    return terms


def compute_voxel_term(
    features: Float[Tensor, "n d"],
    means: Float32[ndarray, "n 3"],
    nodes: UInt16[ndarray, " n"],
    config: InstanceConfig,
    rng: np.random.Generator,
) -> tuple[float, Float[Tensor, "n d"]]:
    """Agreement of all Gaussians inside randomly shifted voxels, node by node, and its gradient."""
    offset = rng.uniform(0, config.voxel_size, 3)
    voxels = group_by_voxel(means, nodes, config.voxel_size, offset)
    return voxel_loss(features, voxels, config.voxel_weight, config.tanh)


def activate_features(features: Float[Tensor, "p d"], config: InstanceConfig) -> Float[Tensor, "p d"]:
    """What the losses act on."""
    return torch.tanh(features) if config.tanh else features


def sample_rendered_pixels(
    features: Float[Tensor, "h w d"],
    alpha: Float32[ndarray, "h w"],
    labels: UInt16[ndarray, "h w"],
    config: InstanceConfig,
    rng: np.random.Generator,
) -> tuple[Float[Tensor, "p d"], UInt16[ndarray, " p"]]:
    """Pixels of a rendered feature map, stratified over masks, those with little opacity left out.

    They come on the CPU, where the losses of so few are quickest.
    """
    usable = np.where(alpha >= config.min_alpha, labels, 0)
    pixels = inst.sample_stratified_pixels(usable, config.pixels_per_view, rng)
    chosen = torch.from_numpy(pixels).to(features.device)
    return features.reshape(-1, features.shape[2])[chosen].cpu(), usable.ravel()[pixels]
