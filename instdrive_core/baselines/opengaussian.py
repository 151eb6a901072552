"""OpenGaussian's instance features on frozen geometry: contrastive features, then a two-level codebook.

Wu, Meng, Li, Wu, Shi, Cheng, Zhao, Feng, Ding, Wang, Zhang: OpenGaussian: Towards Point-Level 3D Gaussian-based Open
Vocabulary Understanding (NeurIPS 2024, arXiv 2406.02058), written from the paper's text; its language features are
left out. What stands in for what the paper uses: docs/baselines.md.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float, Float32, Int64
from numpy import ndarray
from torch import Tensor
from torch.nn.functional import normalize

from instdrive_core.baselines.kmeans import run_lloyd, seed_centers
from instdrive_core.baselines.learnable_features import NO_MASKS, LearnableFeatures
from instdrive_core.maths.streams import Stream, make_generator
from instdrive_core.scene.scene import place_in_world
from instdrive_core.training.gaussians.model import SceneModel
from instdrive_core.training.instances.feature_weights import CachedView, blend_features
from instdrive_core.training.instances.instance_learner import LearnedInstances, cache_views
from instdrive_core.training.instances.instance_losses import average_segments, contrastive_loss
from instdrive_core.training.settings.config import TrainConfig
from instdrive_core.training.settings.schedule import choose_view
from instdrive_core.training.views.view_store import ViewStore


@dataclass(frozen=True)
class OpenGaussianConfig:
    """Values as published, where the paper gives them."""

    feature_dim: int = 6
    """Numbers of the instance feature."""
    feature_iterations: int = 30_000
    """Steps of the contrastive stage, one view each."""
    codebook_iterations: int = 30_000
    """Steps of each of the two codebook stages."""
    feature_lr: float = 1e-3
    """Adam's step in the contrastive stage."""
    codebook_lr: float = 1e-4
    """Adam's step in the codebook stages."""
    init_std: float = 1.0
    """Standard deviation of the first features, before they are normalised."""
    pull_weight: float = 0.1
    """Weight of the intra-mask term."""
    repulsion_offset: float = 1.0
    """ε of the inter-mask term 1 / (distance² + ε)."""
    coarse_clusters: int = 64
    """k1, on features and positions."""
    fine_clusters: int = 10
    """k2, on features within each coarse cluster."""
    position_weight: float = 1.0
    """Weight of positions, scaled to [0, 1] over the scene, beside features in [0, 1]."""
    assign_every: int = 100
    """Steps between two assignments of Gaussians to clusters."""
    first_rounds: int = 20
    """Rounds of k-means when a codebook is made."""


PUBLISHED = OpenGaussianConfig()
# Tuned on one synthetic clip: docs/baselines.md
SHORT = replace(PUBLISHED, feature_iterations=2_000, codebook_iterations=500, feature_lr=0.05, codebook_lr=5e-3)


def learn_opengaussian(
    model: SceneModel,
    store: ViewStore,
    config: TrainConfig,
    on_note: Callable[[str], None],
    settings: OpenGaussianConfig = SHORT,
) -> LearnedInstances:
    """Learn features from the masks, quantise them in two levels, and take the pair of clusters as the ID."""
    cached = cache_views(model, store, config)
    if not cached:
        on_note(NO_MASKS)
        return LearnedInstances(np.zeros(len(model), np.uint32), np.zeros((len(model), 1), np.float32), 0)
    features = LearnableFeatures(len(model), settings.feature_dim, settings.init_std, settings.feature_lr, config.seed)
    for iteration in range(settings.feature_iterations):
        view = cached[choose_view(config.seed, Stream.OPENGAUSSIAN_FEATURE_VIEWS, iteration, len(cached))]
        _contrastive_step(features, view, settings)
    targets = [_pseudo_features(features, view) for view in cached]
    codebook = _Codebook(_scale_positions(model), settings, config.seed)
    levels = (
        (codebook.cluster_coarsely, Stream.OPENGAUSSIAN_COARSE_VIEWS),
        (codebook.cluster_finely, Stream.OPENGAUSSIAN_FINE_VIEWS),
    )
    for level, stream in levels:
        features.restart(settings.codebook_lr)
        level(map_features(features.values).numpy())
        for iteration in range(settings.codebook_iterations):
            if iteration and iteration % settings.assign_every == 0:
                codebook.follow(map_features(features.values).numpy())
            number = choose_view(config.seed, stream, iteration, len(cached))
            _codebook_step(features, codebook, cached[number], targets[number])
        codebook.follow(map_features(features.values).numpy())
    codes = np.unique(codebook.owners)
    on_note(f"codebook: {len(codes)} of {len(codebook.centers)} codes in use")
    return LearnedInstances(codebook.owners.astype(np.uint32), features.values.numpy().copy(), 0)


def map_features(features: Float[Tensor, "n d"]) -> Float[Tensor, "n d"]:
    """Normalise features (L2) and move them from [-1, 1] to [0, 1]: these are rendered and clustered."""
    return normalize(features, dim=1) * 0.5 + 0.5


def _contrastive_step(features: LearnableFeatures, view: CachedView, settings: OpenGaussianConfig) -> None:
    """Pull pixels to the mean of their mask, push the means of masks apart (eq. 1 and 2)."""
    seen = features.leaf(view.rows)
    pull, push = contrastive_loss(blend_features(map_features(seen), view), view.segments, settings.repulsion_offset)
    (settings.pull_weight * pull + push).backward()
    features.descend((view.rows, seen))


@torch.no_grad()
def _pseudo_features(features: LearnableFeatures, view: CachedView) -> Float[Tensor, "p d"]:
    """The mean rendered feature of each pixel's mask."""
    rendered = blend_features(map_features(features.leaf(view.rows)), view)
    return average_segments(rendered, view.segments)[view.segments.segment]


def _codebook_step(
    features: LearnableFeatures, codebook: _Codebook, view: CachedView, targets: Float[Tensor, "p d"]
) -> None:
    """Render each Gaussian's code instead of its feature; the gradient of the code goes to the feature (eq. 3)."""
    seen = features.leaf(view.rows)
    continuous = map_features(seen)
    codes = torch.from_numpy(codebook.look_up_codes(view.rows.numpy()))
    quantized = continuous + (codes - continuous.detach())
    (blend_features(quantized, view) - targets).abs().mean().backward()
    features.descend((view.rows, seen))


class _Codebook:
    """Clusters of all Gaussians: first coarse ones in feature and space, then fine ones within these."""

    def __init__(self, positions: Float32[ndarray, "n 3"], settings: OpenGaussianConfig, seed: int) -> None:
        self._positions = positions * np.float32(settings.position_weight)
        self._settings, self._rng = settings, make_generator(seed, Stream.BASELINE_CLUSTERS)
        self._groups = np.zeros(len(positions), np.int64)
        """Within which a Gaussian is clustered: one, later its coarse cluster."""
        self._starts = np.zeros(2, np.int64)
        self.centers: Float32[ndarray, "k c"] = np.zeros((0, 0), np.float32)
        self.owners: Int64[ndarray, " n"] = np.zeros(len(positions), np.int64)
        """Code of each Gaussian."""

    def cluster_coarsely(self, features: Float32[ndarray, "n d"]) -> None:
        """Make the first level: clusters in feature and space."""
        points = self._points(features)
        self.centers = seed_centers(points, self._settings.coarse_clusters, self._rng)
        self._starts = np.array([0, len(self.centers)], np.int64)
        self._cluster(points, self._settings.first_rounds)

    def cluster_finely(self, features: Float32[ndarray, "n d"]) -> None:
        """Make the second level: positions count no more, and no Gaussian leaves its coarse cluster."""
        self._groups, self._positions = np.unique(self.owners, return_inverse=True)[1], self._positions[:, :0]
        order = np.argsort(self._groups, kind="stable")
        members = np.split(order, np.cumsum(np.bincount(self._groups))[:-1])
        centers = [seed_centers(features[rows], self._settings.fine_clusters, self._rng) for rows in members]
        self.centers = np.concatenate(centers)
        self._starts = np.cumsum([0, *map(len, centers)]).astype(np.int64)
        self._cluster(features, self._settings.first_rounds)

    def follow(self, features: Float32[ndarray, "n d"]) -> None:
        """Follow the features by one round of k-means after they have moved."""
        self._cluster(self._points(features), 1)

    def look_up_codes(self, rows: Int64[ndarray, " v"]) -> Float32[ndarray, "v d"]:
        """Look up the feature part of each row's centre."""
        return self.centers[self.owners[rows], : self._settings.feature_dim]

    def _points(self, features: Float32[ndarray, "n d"]) -> Float32[ndarray, "n c"]:
        return np.concatenate([features, self._positions], axis=1)

    def _cluster(self, points: Float32[ndarray, "n c"], rounds: int) -> None:
        self.owners, self.centers = run_lloyd(points, self.centers, self._starts, self._groups, rounds)


def _scale_positions(model: SceneModel) -> Float32[ndarray, "n 3"]:
    """Scale world positions by the size of the scene; actors stand where they are in the middle of their time.

    The size is the longest side of the box that holds the middle 96 % along each axis; what lies outside is put on
    its border, so that a few far Gaussians do not shrink everything else to a point.
    """
    world_from_node = np.tile(np.eye(4), (len(model.actor_poses.tracks) + 1, 1, 1))
    for node, track in enumerate(model.actor_poses.tracks, start=1):
        time = float(track.times[len(track.times) // 2])
        world_from_node[node] = model.actor_poses.at(time, model.corrections).matrices[node]
    means, quats = (model.parameters[name].detach().numpy() for name in ("means", "quats"))
    means, _ = place_in_world(means, quats, model.nodes, world_from_node)
    low, high = np.quantile(means, [0.02, 0.98], axis=0)
    return (np.clip(means, low, high) - low).astype(np.float32) / np.float32(max((high - low).max(), 1e-6))
