"""Loss terms of instance features: what sampled pixels and voxels ask of them (InstDrive, sec. 3.2 and 3.3)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float, Float32, UInt16
from numpy import ndarray
from torch import Tensor

from instdrive_core.maths.streams import Stream, make_generator
from instdrive_core.training.gaussians.model import SceneModel
from instdrive_core.training.instances.instance_losses import (
    Segments,
    contrastive_loss,
    pseudo_loss,
    sample_stratified_pixels,
)
from instdrive_core.training.instances.voxel_loss import voxel_loss
from instdrive_core.training.instances.voxels import group_by_voxel
from instdrive_core.training.losses.loss_term import LossTerm
from instdrive_core.training.settings.config import InstanceConfig, TrainConfig
from instdrive_core.training.settings.schedule import is_pseudo_supervised


@dataclass
class InstanceStep:
    """Sampled pixels of one view with their masks, and the features of all Gaussians."""

    config: TrainConfig
    iteration: int
    model: SceneModel
    voxel_stream: Stream
    """Random numbers of the voxels' offset."""
    features: Float[Tensor, "p d"] | None = None
    """Rendered features of the sampled pixels; None without any."""
    segments: Segments | None = None
    """Masks of the sampled pixels."""

    @property
    def has_pixels(self) -> bool:
        """Whether a sampled pixel lies in a mask."""
        return self.segments is not None and self.segments.count > 0

    @cached_property
    def activated(self) -> Float[Tensor, "p d"]:
        """The rendered features as the losses see them: through tanh where the configuration says so."""
        assert self.features is not None
        return torch.tanh(self.features) if self.config.instances.tanh else self.features

    @cached_property
    def contrast(self) -> tuple[Tensor, Tensor]:
        """Pull and push, not weighted; computed together."""
        assert self.segments is not None
        return contrastive_loss(self.activated, self.segments, self.config.instances.repulsion_offset)


def _supervise_by_codewords(step: InstanceStep, weight: float) -> Tensor:
    assert step.segments is not None
    return weight * pseudo_loss(step.activated, step.segments)


def _agree_in_voxels(step: InstanceStep, weight: float) -> Tensor:
    """Leave the gradient with the features at once (see `voxel_loss`): the value returned has none."""
    config, features = step.config.instances, step.model.parameters["features"]
    rng = make_generator(step.config.seed, step.voxel_stream, step.iteration)
    means = step.model.parameters["means"].detach().cpu().numpy()
    voxels = group_by_voxel(means, step.model.nodes, config.voxel_size, rng.uniform(0, config.voxel_size, 3))
    value, features.grad = voxel_loss(features, voxels, weight, config.tanh)
    return torch.tensor(value)


INSTANCE_TERMS: tuple[LossTerm[InstanceStep], ...] = (
    LossTerm(
        name="voxel",
        meaning="Gaussians of one randomly shifted voxel agree",
        stage="instances",
        needs="nothing",
        weight_field="instances.voxel_weight",
        compute=_agree_in_voxels,
        is_due=lambda step: step.iteration % step.config.instances.voxel_every == 0,
    ),
    LossTerm(
        name="pull",
        meaning="pixels of a mask are like the mask's mean",
        stage="instances",
        needs="instance masks",
        weight_field="instances.contrastive_weight",
        compute=lambda step, weight: weight * step.contrast[0],
        is_due=lambda step: step.has_pixels,
    ),
    LossTerm(
        name="push",
        meaning="the means of one photo's masks lie apart",
        stage="instances",
        needs="instance masks",
        weight_field="instances.contrastive_weight",
        compute=lambda step, weight: weight * step.contrast[1],
        is_due=lambda step: step.has_pixels,
    ),
    LossTerm(
        name="pseudo",
        meaning="pixels are like the codeword that wins the vote inside their mask",
        stage="instances",
        needs="instance masks",
        weight_field="instances.pseudo_weight",
        compute=_supervise_by_codewords,
        is_due=lambda step: step.has_pixels and is_pseudo_supervised(step.config, step.iteration),
    ),
)


def sample_rendered_pixels(
    features: Float[Tensor, "h w d"],
    alpha: Float32[ndarray, "h w"],
    labels: UInt16[ndarray, "h w"],
    config: InstanceConfig,
    rng: np.random.Generator,
) -> tuple[Float[Tensor, "p d"], UInt16[ndarray, " p"]]:
    """Sample pixels of a rendered feature map, stratified over masks; those with little opacity are left out.

    Returns their features, on the CPU, where the losses of so few are quickest, and their labels.
    """
    usable = np.where(alpha >= config.min_alpha, labels, 0)
    pixels = sample_stratified_pixels(usable, config.pixels_per_view, rng)
    chosen = torch.from_numpy(pixels).to(features.device)
    return features.reshape(-1, features.shape[2])[chosen].cpu(), usable.ravel()[pixels]
