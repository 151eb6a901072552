"""The trainer: an RGB stage on images, then an instance stage on cached blending weights. Knows no files and no UI."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import torch
from jaxtyping import Bool
from numpy import ndarray
from torch import Tensor

from instdrive_core.errors import InstDriveError
from instdrive_core.maths.streams import Stream, make_generator
from instdrive_core.scene.camera import Camera
from instdrive_core.training.backends.backend import Backend
from instdrive_core.training.backends.cpu_backend import CpuBackend
from instdrive_core.training.backends.row_gather import gather_rows
from instdrive_core.training.gaussians.camera_poses import CameraPoses
from instdrive_core.training.gaussians.densify import (
    DensifyResult,
    GrowthStatistics,
    compute_actor_radii,
    counts_gradients,
    densify_and_prune,
    find_last_reset,
    is_densifying_due,
    is_reset_due,
    reset_opacities,
)
from instdrive_core.training.gaussians.edit_guard import EditGuard
from instdrive_core.training.gaussians.last_prune import drop_never_shown
from instdrive_core.training.gaussians.lineage import Lineage
from instdrive_core.training.gaussians.model import SceneModel
from instdrive_core.training.gaussians.mover_reach import LIMIT_MOVERS_EVERY, keep_on_movers
from instdrive_core.training.gaussians.optimizers import Optimizers
from instdrive_core.training.gaussians.size_limit import limit_sizes
from instdrive_core.training.gaussians.view_rendering import RenderedView, render_view
from instdrive_core.training.instances.feature_weights import CachedView, blend_features
from instdrive_core.training.instances.instance_learner import cache_views
from instdrive_core.training.instances.instance_losses import segments_from_labels
from instdrive_core.training.instances.named_masks import MaskNamer, NamedMasks, ObjectTags
from instdrive_core.training.losses.instance_terms import INSTANCE_TERMS, InstanceStep, sample_rendered_pixels
from instdrive_core.training.losses.loss_term import compute_terms
from instdrive_core.training.losses.rgb_terms import RGB_TERMS, RgbStep
from instdrive_core.training.losses.unread_losses import StepLosses, UnreadLosses
from instdrive_core.training.settings.config import TrainConfig
from instdrive_core.training.settings.events import (
    CheckpointDue,
    DensifyDone,
    Event,
    Stage,
    StageStarted,
    StepDone,
    ViewDrawn,
)
from instdrive_core.training.settings.schedule import (
    choose_view,
    compute_means_lr,
    find_edge_start,
    is_coarse,
)
from instdrive_core.training.views.training_view import TrainingView
from instdrive_core.training.views.view_store import ViewStore

PICTURE_EVERY = 50
"""Steps between two pictures of what is drawn; the first step has one."""
_READ_AHEAD = 6
"""Steps whose photos are read while others train."""


class TrainingDivergedError(InstDriveError):
    """A loss or a parameter became NaN or infinite; the message names stage, iteration and term."""


@dataclass
class Trainer:
    """Owns parameters, optimisers and the position in the schedule; everything else is a function of these."""

    model: SceneModel
    store: ViewStore
    config: TrainConfig
    scene_radius: float
    backend: Backend = field(default_factory=CpuBackend)
    stage: Stage = "rgb"
    iteration: int = 0
    """Steps done in the current stage."""
    seconds_before: float = 0.0
    """Training time spent before a resume."""
    lineage: Lineage | None = None
    """Which Gaussian of a finished scene each comes from, where training goes on from one: those are never pruned."""
    guard: EditGuard | None = None
    """Keeps what was edited as it is, where a finished scene was edited; needs `lineage`."""
    name_masks: MaskNamer | None = None
    """Finds out which masks show the same object, so that their edges can be learned; None = no edges are."""
    named_masks: NamedMasks | None = None
    """What it found, once edges are learned."""
    _started: float = field(default_factory=time.perf_counter)
    _cache: list[CachedView] = field(default_factory=list)
    _drawn: tuple[TrainingView, Tensor] | None = None
    """Photo of the last RGB step, and what was drawn for it."""
    _unread: UnreadLosses = field(default_factory=UnreadLosses)
    _last_losses: StepLosses = field(default_factory=lambda: StepLosses(0, {}, float("nan")))

    def __post_init__(self) -> None:
        self.model.move_to(self.backend.device)
        self.optimizers = Optimizers(self.model, self.config, self.backend.uses_kernels)
        self.growth = GrowthStatistics.empty(len(self.model), self.backend.device)
        self.cameras = CameraPoses(self.store.facts, self.config.geometry)
        self.has_masks = any(photo.has_masks for photo in self.store.facts)
        """Without a single mask no instance can be learned."""
        if self.config.freeze_geometry:
            self.stage = "instances"

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
        self.store.place_cameras(self.cameras.list_poses())
        if instances and self.has_masks:
            yield from self._stage(instances)

    def _stage(self, total: int) -> Iterator[Event]:
        message = ""
        if self.stage == "instances":
            message = f"caching the blending weights of {len(self.store)} views"
        yield StageStarted(self.stage, self.iteration, total, message)
        while self.iteration < total:
            if self.stage == "rgb" and self._wants_names():
                yield StageStarted(self.stage, self.iteration, total, "finding out which masks show the same object")
                self.named_masks = self._name_masks()
            if self.stage == "rgb":
                self.rgb_step()
            else:
                self.instance_step()
            refinement = self.after_rgb_step() if self.stage == "rgb" else None
            self.iteration += 1
            if refinement is not None:
                yield refinement
            if self.iteration % self.config.report_every == 0 or self.iteration == total:
                losses = self.read_losses()
                yield StepDone(
                    self.stage,
                    self.iteration,
                    total,
                    sum(losses.terms.values()),
                    losses.psnr if self.stage == "rgb" else None,
                    len(self.model),
                    self.seconds,
                    losses.terms,
                )
            if self.stage == "rgb" and (self.iteration - 1) % PICTURE_EVERY == 0 and self._drawn is not None:
                yield self._show_drawn(*self._drawn)
            if self.iteration % self.config.checkpoint_every == 0 or self.iteration == total:
                self.check_parameters()
                yield CheckpointDue(self.stage, self.iteration, ends_stage=self.iteration == total)

    # One step of each stage, from top to bottom.

    def rgb_step(self) -> None:
        """One image: draw, compare, descend. With the `joint` schedule the instance losses ride along."""
        config, shared, backend = self.config.geometry, self.model.shared, self.backend
        number, coarse = self._choose_view(self.iteration)
        self.store.prefetch([self._choose_view(self.iteration + ahead) for ahead in range(1, _READ_AHEAD)])
        view = self.store.get(number, coarse)
        if self.guard is not None:
            view = self.guard.restrict(number, view)
        rides_along = self.config.trains_features and self.config.instances.schedule == "joint"
        joint = rides_along and view.labels is not None

        camera = self.cameras.correct(number, view.camera)
        tags = self._draw_tags(number, view)
        drawn = render_view(self.model, backend, camera, view.time, joint, None if tags is None else tags.of_gaussians)
        image = backend.composite_over_sky(drawn.color, drawn.alpha, shared["sky"], camera)
        if config.exposure_lr:
            image = backend.expose(image, shared["exposures"][number])

        self._drawn = view, image.detach()
        step = RgbStep(self.config, backend, number, view, drawn, image, shared["exposures"], tags)
        terms = compute_terms(RGB_TERMS, step)
        if joint:
            terms |= compute_terms(INSTANCE_TERMS, self._sample_joint_pixels(view, drawn))

        self._backward(terms, step.psnr)
        if self.named_masks is not None:
            self._hold_poses()
        elif not coarse:
            self._descend_camera(number, camera, drawn)
        self._descend(drawn)

    def instance_step(self) -> None:
        """One view's sampled pixels, features only: F_pix = W F with the cached weights of the frozen geometry."""
        if not self._cache:
            self.continue_on_cpu()
            self._cache = cache_views(self.model, self.store, self.config)
        step, seen = InstanceStep(self.config, self.iteration, self.model, Stream.INSTANCE_VOXELS), None
        if self._cache:
            view = self._cache[choose_view(self.config.seed, Stream.INSTANCE_VIEWS, self.iteration, len(self._cache))]
            leaf = gather_rows(self.model.parameters["features"], view.rows).requires_grad_(True)
            step.features, step.segments = blend_features(leaf, view), view.segments
            seen = (view.rows, leaf)
        self._backward(compute_terms(INSTANCE_TERMS, step))
        self._descend_features(None if seen is None or seen[1].grad is None else (seen[0], seen[1].grad, None))

    # What the steps are made of.

    def _wants_names(self) -> bool:
        due = self.config.learns_edges and self.iteration >= find_edge_start(self.config)
        return due and self.has_masks and self.name_masks is not None and self.named_masks is None

    def _name_masks(self) -> NamedMasks:
        """Name the masks as the photos show the objects now, through cameras as corrected so far."""
        assert self.name_masks is not None
        self.store.place_cameras(self.cameras.list_poses())
        try:
            return self.name_masks(self.model if self.backend.uses_kernels else self.model.copy_to_cpu(), self.store)
        finally:
            self.store.place_cameras(None)

    def _draw_tags(self, number: int, view: TrainingView) -> ObjectTags | None:
        """Draw a step's tags of the objects, where edges are learned and the view has masks that teach any."""
        if self.named_masks is None:
            return None
        rng = make_generator(self.config.seed, Stream.EDGE_TAGS, self.iteration)
        return self.named_masks.draw_tags(number, view.layers, self.config.geometry.edge_fit, rng, self.backend.device)

    def _show_drawn(self, view: TrainingView, image: Tensor) -> ViewDrawn:
        pixels = (image.clamp(0, 1) * 255).round().to(torch.uint8).cpu().numpy()
        return ViewDrawn(self.iteration, view.key, pixels, view.image)

    def _choose_view(self, iteration: int) -> tuple[int, bool]:
        number = choose_view(self.config.seed, Stream.RGB_VIEWS, iteration, len(self.store))
        return number, is_coarse(self.config.geometry, iteration)

    def _sample_joint_pixels(self, view: TrainingView, drawn: RenderedView) -> InstanceStep:
        """Sample the rendered features of an RGB step for the instance losses that ride along."""
        assert view.labels is not None
        assert drawn.features is not None
        rng = make_generator(self.config.seed, Stream.JOINT_PIXELS, self.iteration)
        alpha = drawn.alpha.detach().cpu().numpy()
        features, labels = sample_rendered_pixels(drawn.features, alpha, view.labels, self.config.instances, rng)
        segments = segments_from_labels(labels)
        return InstanceStep(self.config, self.iteration, self.model, Stream.JOINT_VOXELS, features, segments)

    def read_losses(self) -> StepLosses:
        """Read the losses of all steps since the last call, which waits for the device once, and return the last ones.

        Raises TrainingDivergedError for the first step with a loss that is not finite.
        """
        for losses in self._unread.read():
            self._last_losses = losses
            for name, value in losses.terms.items():
                if not np.isfinite(value):
                    raise self._describe_divergence(f"{name} loss is {value}", losses.iteration)
        return self._last_losses

    def _backward(self, terms: dict[str, Tensor], psnr: Tensor | float = float("nan")) -> None:
        """Compute the gradients of all terms. Their values are read at once only where that costs no wait."""
        self._unread.add(self.iteration, terms, psnr, self.backend.device)
        if self.backend.uses_kernels:
            self.read_losses()
        graphs = [term for term in terms.values() if term.requires_grad]
        if graphs:
            torch.stack([term.to(self.backend.device) for term in graphs]).sum().backward()

    def _descend(self, drawn: RenderedView) -> None:
        optimizers, gradients = self.optimizers, drawn.gradients()
        self._leave_out_edited(drawn)
        rendered = gradients.pop("features", None)
        optimizers.geometry.rates["means"] = compute_means_lr(self.config.geometry, self.iteration, self.scene_radius)
        optimizers.geometry.step(drawn.rows, gradients, drawn.seen.visible)
        optimizers.step_shared(self.model)
        if rendered is not None:
            self._descend_features((drawn.rows, rendered, drawn.seen.visible))
        if counts_gradients(self.config.densify, self.iteration, self.config.geometry.iterations):
            self.growth.add(drawn.rows, drawn.seen)

    def _leave_out_edited(self, drawn: RenderedView) -> None:
        """Count edited Gaussians as not seen: they neither change nor grow."""
        if self.guard is None or self.lineage is None or drawn.seen.visible is None:
            return
        learning = self.guard.choose_learning(self.lineage.ancestors[drawn.rows.cpu().numpy()])
        drawn.seen.visible &= torch.from_numpy(learning).to(drawn.seen.visible.device)

    def _descend_camera(self, number: int, camera: Camera, drawn: RenderedView) -> None:
        """Descend the photo's pose along the gradient of all that it saw; the sky is too far off to tell."""
        means, quats = drawn.placed
        if not self.cameras.are_learned or means.grad is None or quats.grad is None:
            return
        force, torque = self.backend.sum_rigid_gradient(means, quats, means.grad, quats.grad)
        self.cameras.step(number, camera, force, torque, self.iteration / self.config.geometry.iterations)

    def _hold_poses(self) -> None:
        """Leave cameras and tracks where they are: masks are ragged and say nothing of poses."""
        for correction in self.model.corrections.values():
            correction.grad = None

    def _descend_features(self, seen: tuple[Tensor, Tensor, Tensor | None] | None) -> None:
        """Descend along the voxel loss's gradient of all features, and the blended map's of those that a view saw:
        their rows, gradients and, where not all of them, which were visible."""
        features, optimizer = self.model.parameters["features"], self.optimizers.features
        assert optimizer is not None
        everywhere, features.grad = features.grad, None
        if everywhere is None and seen is not None:
            rows, gradient, visible = seen
            optimizer.step(rows, {"features": gradient}, visible)
        elif everywhere is not None:
            if seen is not None:
                everywhere.index_add_(0, seen[0], seen[1])
            rows = torch.arange(len(features), device=features.device)
            optimizer.step(rows, {"features": everywhere}, None)

    def after_rgb_step(self) -> DensifyDone | None:
        """Limit sizes, grow and prune where the schedule says so; the step at `iteration` has just been done."""
        config, total = self.config.densify, self.config.geometry.iterations
        if self.iteration % config.every == 0 or self.iteration == total - 1:
            limit_sizes(self.model.parameters, self.model.nodes, self._spared)
        if self.iteration % LIMIT_MOVERS_EVERY == 0 or self.iteration == total - 1:
            self._keep_on_movers()
        if is_densifying_due(config, self.iteration, total):
            rng = make_generator(self.config.seed, Stream.DENSIFY, self.iteration)
            result = densify_and_prune(
                self.model.parameters,
                self.model.nodes,
                self.growth,
                config,
                self.scene_radius,
                rng,
                allow_scale_pruning=find_last_reset(config, self.iteration, total) > 0,
                radii=compute_actor_radii(self.model.actor_poses.tracks),
                spared=self._spared,
            )
            self._rearrange(result)
            return DensifyDone(self.iteration + 1, len(self.model), result.cloned, result.split, result.pruned)
        if is_reset_due(config, self.iteration, total):
            reset_opacities(self.model.parameters, self.optimizers.geometry, config)
        if self.iteration == total - 1:
            self.named_masks = None  # they name rows, and have taught what they can
            self._rearrange(drop_never_shown(self.model.parameters, self.model.nodes, self._spared))
        return None

    def _rearrange(self, result: DensifyResult) -> None:
        if self.lineage is not None:
            self.lineage = self.lineage.rearrange(result.parents, result.fresh)
        self.model.parameters, self.model.nodes = result.parameters, result.nodes
        self.optimizers.rearrange(result.parents, result.fresh, self.model)
        self.growth = GrowthStatistics.empty(len(self.model), self.backend.device)

    @property
    def _spared(self) -> Bool[ndarray, " n"] | None:
        """Rows of a finished scene that training goes on from; None where it does not."""
        return None if self.lineage is None else self.lineage.stands

    def _keep_on_movers(self) -> None:
        boxes = np.array([track.dimensions for track in self.model.actor_poses.tracks], np.float64).reshape(-1, 3)
        keep_on_movers(self.model.parameters, self.model.nodes, boxes, self._spared)

    def continue_on_cpu(self) -> None:
        """Move everything to the CPU: the instance stage is sparse products on frozen geometry, which take no GPU."""
        if not self.backend.uses_kernels:
            self.read_losses()
            state = {name: value.cpu() for name, value in self.optimizers.state_tensors().items()}
            self.backend = CpuBackend()
            self.model.move_to(self.backend.device)
            self.optimizers = Optimizers(self.model, self.config)
            self.optimizers.load_state_tensors(state)

    def end_training(self) -> None:
        """Move the model to the CPU and give back what only steps need: Adam's moments are twice as large as the model.

        No step may follow; the checkpoint of the last one has everything.
        """
        self.read_losses()
        del self.optimizers, self.growth
        self._cache, self._drawn = [], None
        self.backend = CpuBackend()
        self.model.move_to(self.backend.device)

    def check_parameters(self) -> None:
        """Check that all losses so far and all parameters are finite: parameters that are not are not drawn, so no loss
        would show them, and no checkpoint may hold them."""
        self.read_losses()
        for name, value in {**self.model.parameters, **self.model.shared}.items():
            if not bool(torch.isfinite(value).all()):
                raise self._describe_divergence(f"{name} is not finite", self.iteration)

    def _describe_divergence(self, what: str, iteration: int) -> TrainingDivergedError:
        return TrainingDivergedError(
            f"{what} at step {iteration} of the {self.stage} stage. Check the clip's photos and poses; "
            "--resume goes on from the last checkpoint."
        )
