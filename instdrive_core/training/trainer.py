"""The trainer: an RGB stage on images, then an instance stage on cached blending weights. Knows no files and no UI."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from instdrive_core.errors import InstDriveError
from instdrive_core.training import instance_losses as inst
from instdrive_core.training import losses
from instdrive_core.training.autograd import rasterize, sh_colors
from instdrive_core.training.config import InstanceConfig, TrainConfig
from instdrive_core.training.events import CheckpointDue, Event, Stage, StageStarted, StepDone
from instdrive_core.training.feature_weights import CachedView, cached_view, weighted_features
from instdrive_core.training.model import SceneModel
from instdrive_core.training.photometric import photometric_loss
from instdrive_core.training.schedule import is_coarse, means_lr, pseudo_is_on, step_rng, view_of_step
from instdrive_core.training.sky_blend import over_sky
from instdrive_core.training.views import TrainingView
from instdrive_core.training.voxel_loss import occupied_voxels, voxel_loss

_RGB, _INSTANCES, _SAMPLING = 0, 1, 2
"""Streams of random numbers."""
_SKY_EPS = 1e-8
"""Texels that photos hardly touch stay as they are, instead of taking full steps along rounding errors."""


class TrainingDivergedError(InstDriveError):
    """A loss became NaN or infinite; the message names stage, iteration and term."""


@dataclass
class Trainer:
    """Owns parameters, optimisers and the position in the schedule; everything else is a function of these."""

    model: SceneModel
    views: list[TrainingView]
    config: TrainConfig
    scene_radius: float
    stage: Stage = "rgb"
    iteration: int = 0
    """Steps done in the current stage."""
    seconds_before: float = 0.0
    """Training time spent before a resume."""
    _started: float = field(default_factory=time.perf_counter)
    _cache: list[CachedView] = field(default_factory=list)

    def __post_init__(self) -> None:
        geometry, p = self.config.geometry, self.model.parameters
        rates = {
            "means": means_lr(geometry, 0, self.scene_radius),
            "quats": geometry.rotation_lr,
            "log_scales": geometry.scale_lr,
            "opacity_logits": geometry.opacity_lr,
            "sh_dc": geometry.sh_dc_lr,
            "sh_rest": geometry.sh_rest_lr,
            "sky": geometry.sky_lr,
            "features": self.config.instances.feature_lr,
        }
        self.optimizers = {
            name: torch.optim.Adam([p[name]], lr=rate, eps=_SKY_EPS if name == "sky" else 1e-15, fused=True)
            for name, rate in rates.items()
            if p[name].numel()
        }
        self._coarse = [view.halved() for view in self.views] if geometry.coarse_iterations else []
        self.has_masks = any(view.labels is not None and view.labels.any() for view in self.views)
        """Without a single mask no instance can be learned."""

    @property
    def seconds(self) -> float:
        """Training time so far, resumed parts included."""
        return self.seconds_before + time.perf_counter() - self._started

    def run(self) -> Iterator[Event]:
        """Train from where it stands to the end, stage after stage."""
        geometry, instances = self.config.geometry, self.config.instance_iterations
        if self.stage == "rgb":
            yield from self._stage(geometry.iterations)
            self.stage, self.iteration = "instances", 0
        if instances and self.has_masks:
            yield from self._stage(instances)

    def _stage(self, total: int) -> Iterator[Event]:
        message = ""
        if self.stage == "instances":
            message = f"caching the blending weights of {len(self.views)} views"
        yield StageStarted(self.stage, self.iteration, total, message)
        while self.iteration < total:
            terms, image_psnr = self.rgb_step() if self.stage == "rgb" else self.instance_step()
            self.iteration += 1
            if self.iteration % self.config.report_every == 0 or self.iteration == total:
                yield StepDone(
                    self.stage,
                    self.iteration,
                    total,
                    sum(terms.values()),
                    image_psnr,
                    len(self.model),
                    self.seconds,
                    terms,
                )
            if self.iteration % self.config.checkpoint_every == 0 or self.iteration == total:
                yield CheckpointDue(self.stage, self.iteration)

    # One step of each stage, from top to bottom.

    def rgb_step(self) -> tuple[dict[str, float], float]:
        """One image: render, compare, step. With the `joint` schedule the instance losses ride along."""
        config, p = self.config.geometry, self.model.parameters
        views = self._coarse if is_coarse(config, self.iteration) else self.views
        view = views[view_of_step(self.config.seed, _RGB, self.iteration, len(views))]
        target = torch.from_numpy(view.image).float() / 255
        valid = None if view.valid is None else torch.from_numpy(view.valid)

        poses, present = self.model.poses_at(view.time)
        means, quats, logits = self.model.placed(poses, present)
        colors = sh_colors(means, p["sh_dc"], p["sh_rest"], view.camera.position, self.model.nodes, poses)
        joint = self.config.instances.schedule == "joint" and view.labels is not None
        channels = torch.cat([colors, p["features"]], dim=1) if joint else colors
        drawn, depth, alpha = rasterize(means, quats, p["log_scales"], logits, channels, view.camera, 3)
        image = over_sky(drawn[..., :3], alpha, p["sky"], view.camera)

        terms = {"rgb": photometric_loss(image, target, valid, config.ssim_weight)}
        if config.depth_weight and len(view.depth_pixels):
            lidar = torch.from_numpy(view.depth_map())
            terms["depth"] = config.depth_weight * losses.depth_loss(depth, alpha, lidar)
        if config.sky_weight and view.sky is not None:
            terms["sky"] = config.sky_weight * losses.sky_loss(alpha, torch.from_numpy(view.sky))
        if joint:
            terms |= self._joint_instance_terms(view, drawn[..., 3:], alpha.detach().numpy())

        self.optimizers["means"].param_groups[0]["lr"] = means_lr(config, self.iteration, self.scene_radius)
        values = self._descend(terms)
        return values, losses.psnr(image, target, valid)

    def instance_step(self) -> tuple[dict[str, float], None]:
        """One view's sampled pixels, features only: F_pix = W F with the cached weights of the frozen geometry."""
        if not self._cache:
            self._cache = self._cached_views()
        view = self._cache[view_of_step(self.config.seed, _INSTANCES, self.iteration, len(self._cache))]
        features = weighted_features(self.model.parameters["features"], view.weights)
        terms = self._instance_terms(features, view.labels, _INSTANCES)
        return self._descend(terms), None

    # The instance losses, shared by both schedules.

    def _instance_terms(self, features: Tensor, labels: np.ndarray, stage: int) -> dict[str, Tensor]:
        config = self.config.instances
        terms: dict[str, Tensor] = {}
        if len(labels):
            segments = inst.segments_of(labels)
            seen = _activated(features, config)
            pull, push = inst.contrastive_loss(seen, segments, config.repulsion_offset)
            terms["pull"], terms["push"] = config.contrastive_weight * pull, config.contrastive_weight * push
            if config.pseudo_weight and pseudo_is_on(self.config, self.iteration):
                terms["pseudo"] = config.pseudo_weight * inst.pseudo_loss(seen, segments)
        if config.voxel_weight and self.iteration % config.voxel_every == 0:
            terms["voxel"] = config.voxel_weight * self._voxel_term(stage)
        return terms

    def _voxel_term(self, stage: int) -> Tensor:
        config, p = self.config.instances, self.model.parameters
        offset = step_rng(self.config.seed, stage, self.iteration).uniform(0, config.voxel_size, 3)
        positions = p["means"].detach().numpy()
        voxels = occupied_voxels(positions, self.model.nodes, config.voxel_size, offset)
        return voxel_loss(_activated(p["features"], config), voxels)

    def _joint_instance_terms(self, view: TrainingView, features: Tensor, alpha: np.ndarray) -> dict[str, Tensor]:
        config = self.config.instances
        assert view.labels is not None
        usable = np.where(alpha >= config.min_alpha, view.labels, 0)
        rng = step_rng(self.config.seed, _RGB, self.iteration)
        pixels = inst.stratified_pixels(usable, config.pixels_per_view, rng)
        sampled = features.reshape(-1, features.shape[2])[torch.from_numpy(pixels)]
        return self._instance_terms(sampled, usable.ravel()[pixels], _RGB)

    # Helpers of the steps.

    def _descend(self, terms: dict[str, Tensor]) -> dict[str, float]:
        values = {name: float(term.detach()) for name, term in terms.items()}
        for name, value in values.items():
            if not np.isfinite(value):
                raise TrainingDivergedError(
                    f"{name} loss is {value} at step {self.iteration} of the {self.stage} stage. Check the clip's "
                    "photos and poses; --resume goes on from the last checkpoint."
                )
        if terms:
            torch.stack(list(terms.values())).sum().backward()
        for optimizer in self.optimizers.values():
            optimizer.step()
            optimizer.zero_grad(set_to_none=True)
        return values

    def _cached_views(self) -> list[CachedView]:
        config = self.config.instances
        cached = []
        for number, view in enumerate(self.views):
            if view.labels is None or not view.labels.any():
                continue
            pixels = inst.stratified_pixels(
                view.labels, config.pixels_per_view, step_rng(self.config.seed, _SAMPLING, number)
            )
            cached.append(cached_view(self.model, view, pixels, config.min_alpha))
        return cached


def _activated(features: Tensor, config: InstanceConfig) -> Tensor:
    return torch.tanh(features) if config.tanh else features
