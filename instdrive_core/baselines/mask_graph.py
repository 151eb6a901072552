"""The mask graph alone: masks of all photos are clustered by what they agree on, Gaussians vote. Nothing is trained.

The clustering follows the view consensus of Yan, Zhang, Zhu, Wang: MaskClustering (CVPR 2024, arXiv 2401.07745), on
Gaussians instead of points and as one average linkage. It is the control beside our own method, which clusters
Gaussians instead of masks. What is as published and what is not: docs/baselines.md.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

import numpy as np
from jaxtyping import Int64
from numpy import ndarray
from scipy.sparse import csr_array

from instdrive_core.baselines.learnable_features import NO_MASKS
from instdrive_core.baselines.mask_consensus import MaskGraphConfig, find_dropped_masks, link_masks, relate_masks
from instdrive_core.baselines.mask_members import MaskMembers, find_mask_members
from instdrive_core.instances.interiors import fill_from_nearest
from instdrive_core.training.gaussians.model import SceneModel
from instdrive_core.training.instances.instance_learner import LearnedInstances
from instdrive_core.training.settings.config import TrainConfig
from instdrive_core.training.views.view_store import ViewStore

DEFAULT = MaskGraphConfig()


def learn_mask_graph(
    model: SceneModel,
    store: ViewStore,
    config: TrainConfig,
    on_note: Callable[[str], None],
    settings: MaskGraphConfig = DEFAULT,
) -> LearnedInstances:
    """Cluster the masks and give each Gaussian the cluster of most masks that it belongs to (an `InstanceLearner`).

    Gaussians in no mask take the cluster of the nearest one of their node, 0 where a node has none.
    """
    of = find_mask_members(model, store, config.instances.min_alpha, settings.member_share)
    if not len(of.view_of_mask):
        on_note(NO_MASKS)
        return LearnedInstances(np.zeros(len(model), np.uint32), np.zeros((len(model), 1), np.float32), 0)
    clusters = cluster_masks(of, settings)
    found, used = len(np.unique(clusters[clusters >= 0])), np.count_nonzero(clusters >= 0)
    on_note(f"mask graph: {used:,} of {len(clusters):,} masks in {found} clusters")
    groups = vote_clusters(of, clusters)
    groups = fill_from_nearest(groups, model.parameters["means"].detach().numpy(), model.nodes)
    return LearnedInstances((groups + 1).astype(np.uint32), np.zeros((len(model), 1), np.float32), 0)


def cluster_masks(of: MaskMembers, settings: MaskGraphConfig = DEFAULT) -> Int64[ndarray, " m"]:
    """Cluster the masks 0 … k - 1; -1 for dropped ones."""
    relations = relate_masks(of, settings)
    dropped = find_dropped_masks(relations, settings)
    clusters = np.full(len(dropped), -1, np.int64)
    clusters[~dropped] = link_masks(relations.exclude(dropped), settings)
    return clusters


def vote_clusters(of: MaskMembers, clusters: Int64[ndarray, " m"]) -> Int64[ndarray, " n"]:
    """Find the cluster that most masks of each Gaussian are in (ties: the lower one); -1 = in none."""
    masks = np.flatnonzero(clusters >= 0)
    shape = (len(clusters), int(clusters.max(initial=-1)) + 1)
    cluster_of_mask = csr_array((np.ones(len(masks), np.float32), (masks, clusters[masks])), shape=shape)
    votes = cast(csr_array, of.members @ cluster_of_mask).tocoo()
    rows, columns = votes.coords
    order = np.lexsort((columns, np.negative(votes.data), rows))
    rows, first = np.unique(rows[order], return_index=True)
    winners = np.full(len(of), -1, np.int64)
    winners[rows] = columns[order][first]
    return winners
