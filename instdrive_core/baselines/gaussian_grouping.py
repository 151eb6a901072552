"""Gaussian Grouping on frozen geometry: an identity encoding per Gaussian, classified into tracked masks.

Ye, Danelljan, Yu, Ke: Gaussian Grouping: Segment and Edit Anything in 3D Scenes (ECCV 2024, arXiv 2312.00732),
written from the paper's text. What stands in for what the paper uses: docs/baselines.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from jaxtyping import Float, Int64, UInt16, UInt32
from numpy import ndarray
from scipy.spatial import KDTree
from torch import Tensor
from torch.nn.functional import cross_entropy, log_softmax

from instdrive_core.baselines.iou_tracker import MaskTracks, TrackerConfig, track_masks
from instdrive_core.baselines.learnable_features import NO_MASKS, LearnableFeatures
from instdrive_core.maths.streams import Stream, make_generator
from instdrive_core.training.gaussians.model import SceneModel
from instdrive_core.training.instances.feature_weights import CachedView, blend_features
from instdrive_core.training.instances.instance_learner import LearnedInstances, cache_views
from instdrive_core.training.settings.config import TrainConfig
from instdrive_core.training.settings.schedule import choose_view
from instdrive_core.training.views.view_store import ViewStore


@dataclass(frozen=True)
class GaussianGroupingConfig:
    """Values as published, where the paper gives them."""

    iterations: int = 30_000
    """Steps of one view each."""
    encoding_dim: int = 16
    """Numbers of the identity encoding."""
    encoding_lr: float = 2.5e-3
    """Adam's step for encodings."""
    classifier_lr: float = 5e-4
    """Adam's step for the linear layer that all pixels and Gaussians share."""
    init_std: float = 1.0
    """Standard deviation of the first encodings."""
    neighbor_weight: float = 2.0
    """Weight of the 3D term."""
    neighbor_every: int = 5
    """Steps between two 3D terms."""
    neighbor_samples: int = 1000
    """Gaussians that a 3D term looks at."""
    neighbors: int = 5
    """Nearest Gaussians of each that should agree with it."""
    tracker: TrackerConfig = field(default_factory=TrackerConfig)


PUBLISHED = GaussianGroupingConfig()
# Tuned on one synthetic clip: docs/baselines.md
SHORT = replace(PUBLISHED, iterations=2_000, encoding_lr=0.05, classifier_lr=5e-3)


def learn_gaussian_grouping(
    model: SceneModel,
    store: ViewStore,
    config: TrainConfig,
    on_note: Callable[[str], None],
    settings: GaussianGroupingConfig = SHORT,
) -> LearnedInstances:
    """Track masks, learn encodings and classifier, and give each Gaussian its most probable class."""
    cached = cache_views(model, store, config)
    if not cached:
        on_note(NO_MASKS)
        return LearnedInstances(np.zeros(len(model), np.uint32), np.zeros((len(model), 1), np.float32), 0)
    tracks = track_masks(model, store, cached, settings.tracker)
    masks = sum(view.segments.count for view in cached)
    on_note(f"IoU tracker: {masks:,} masks of {len(cached)} views are {tracks.count} things")
    learner = _Learner(model, cached, tracks, config.seed, settings)
    for iteration in range(settings.iterations):
        learner.step(iteration)
    return LearnedInstances(learner.most_probable(), learner.encodings.values.numpy().copy(), 0)


class _Learner:
    """Encodings, classifier and their optimisers; a step depends on these and the iteration alone."""

    def __init__(
        self,
        model: SceneModel,
        cached: list[CachedView],
        tracks: MaskTracks,
        seed: int,
        settings: GaussianGroupingConfig,
    ) -> None:
        self.settings, self.seed, self.classes = settings, seed, max(tracks.count, 2)
        self.encodings = LearnableFeatures(
            len(model), settings.encoding_dim, settings.init_std, settings.encoding_lr, seed
        )
        self.classifier = _first_classifier(settings.encoding_dim, self.classes, seed)
        self._optimizer = torch.optim.Adam(self.classifier, lr=settings.classifier_lr, fused=True)
        self._neighbors = _Neighbors(model.parameters["means"].detach().numpy(), model.nodes)
        self._targets = [
            torch.from_numpy(track)[view.segments.segment] for view, track in zip(cached, tracks.by_view, strict=True)
        ]
        self._cached = cached

    def step(self, iteration: int) -> None:
        """One view's sampled pixels and, where it is due, the 3D term."""
        number = choose_view(self.seed, Stream.GROUPING_VIEWS, iteration, len(self._cached))
        view, targets = self._cached[number], self._targets[number]
        seen = self.encodings.leaf(view.rows)
        parts, loss = [(view.rows, seen)], torch.zeros(())
        if bool((targets >= 0).any()):
            logits = self.logits(blend_features(seen, view))
            loss = loss + cross_entropy(logits, targets, ignore_index=-1) / math.log(self.classes)
        if self.settings.neighbor_weight and iteration % self.settings.neighbor_every == 0:
            rows, leaf, divergence = self._neighbor_term(iteration)
            loss = loss + self.settings.neighbor_weight * divergence
            parts.append((rows, leaf))
        if not loss.requires_grad:
            return
        self._optimizer.zero_grad(set_to_none=True)
        loss.backward()
        self._optimizer.step()
        self.encodings.descend(*parts)

    def logits(self, encodings: Float[Tensor, "p d"]) -> Float[Tensor, "p k"]:
        """The shared linear layer."""
        weight, bias = self.classifier
        return torch.addmm(bias, encodings, weight)

    def _neighbor_term(self, iteration: int) -> tuple[Int64[Tensor, " v"], Float[Tensor, "v d"], Float[Tensor, ""]]:
        """Mean KL(own ‖ neighbour's) of class probabilities over samples and their neighbours (eq. 4)."""
        chosen = self._neighbors.sample(
            self.settings.neighbor_samples,
            self.settings.neighbors,
            make_generator(self.seed, Stream.GROUPING_NEIGHBORS, iteration),
        )
        rows, places = np.unique(chosen, return_inverse=True)
        leaf = self.encodings.leaf(torch.from_numpy(rows))
        logarithms = log_softmax(self.logits(leaf), dim=1)[torch.from_numpy(places.reshape(chosen.shape))]
        own, others = logarithms[:, :1], logarithms[:, 1:]
        return torch.from_numpy(rows), leaf, (own.exp() * (own - others)).sum(dim=2).mean()

    @torch.no_grad()
    def most_probable(self) -> UInt32[ndarray, " n"]:
        """argmax of each Gaussian's own logits."""
        parts = [self.logits(part).argmax(dim=1) for part in self.encodings.values.split(1 << 15)]
        return torch.cat(parts).numpy().astype(np.uint32)


class _Neighbors:
    """Nearest Gaussians of the same node."""

    def __init__(self, means: Float[ndarray, "n 3"], nodes: UInt16[ndarray, " n"]) -> None:
        apart = 2 * float(np.linalg.norm(np.ptp(means, axis=0))) + 1
        self._places = np.column_stack([means, nodes * apart])
        self._tree = KDTree(self._places)

    def sample(self, samples: int, neighbors: int, rng: np.random.Generator) -> Int64[ndarray, "s m"]:
        """Random rows, each with its nearest ones behind it."""
        rows = rng.choice(len(self._places), min(samples, len(self._places)), replace=False)
        count = min(neighbors + 1, len(self._places))
        _, found = self._tree.query(self._places[rows], k=count)
        found = np.asarray(found, np.int64).reshape(len(rows), count)
        # Of Gaussians in one place any may come first.
        others = np.where(found == rows[:, None], found[:, :1], found)
        return np.column_stack([rows, others[:, 1:]])


def _first_classifier(dim: int, classes: int, seed: int) -> list[Tensor]:
    """Weight (dim, classes) and bias, uniform within ±1/√dim."""
    rng, bound = make_generator(seed, Stream.BASELINE_CLASSIFIER), 1 / math.sqrt(dim)
    weight, bias = rng.uniform(-bound, bound, (dim, classes)), rng.uniform(-bound, bound, classes)
    return [torch.from_numpy(values.astype(np.float32)).requires_grad_(True) for values in (weight, bias)]
