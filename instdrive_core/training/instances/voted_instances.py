"""Our instance stage: affinity graph, weighted votes, interiors, and a codeword for each instance. No gradients.

Geometry is finished, masks are given: what is left is to find out which masks mean the same thing, and that is counting
(docs/decisions/0008-votes-instead-of-training.md).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float64, Int64
from numpy import ndarray

from instdrive_core.instances.codebook import decode_codewords
from instdrive_core.instances.interiors import fill_compact_objects, fill_from_nearest
from instdrive_core.instances.separated_codes import generate_separated_codewords
from instdrive_core.instances.similarity import fill_from_similar
from instdrive_core.masks.lidar.scene import LidarScene
from instdrive_core.maths.activations import sigmoid
from instdrive_core.maths.spherical_harmonics import color_from_dc
from instdrive_core.maths.splat_axes import compute_normals
from instdrive_core.training.gaussians.first_shadows import find_model_shadows
from instdrive_core.training.gaussians.model import SceneModel
from instdrive_core.training.instances.affinity_graph import merge_groups
from instdrive_core.training.instances.ground_mending import mend_ground
from instdrive_core.training.instances.instance_learner import LearnedInstances
from instdrive_core.training.instances.lidar_things import add_lidar_masks, assign_lidar_things, measure_silence
from instdrive_core.training.instances.mask_votes import compute_vote_shares, vote_groups
from instdrive_core.training.instances.mask_weights import MaskWeights, measure_mask_weights
from instdrive_core.training.instances.strays import find_reaches, find_strays, give_strays_away
from instdrive_core.training.instances.superpoints import find_neighbor_pairs, join_superpoints
from instdrive_core.training.instances.upper_pieces import join_upper_pieces
from instdrive_core.training.settings.config import GraphConfig, TrainConfig
from instdrive_core.training.views.view_store import ViewStore

_FEATURE = 0.5
"""Features are this multiple of the codeword's vector."""


def vote_instances(
    model: SceneModel,
    store: ViewStore,
    config: TrainConfig,
    on_note: Callable[[str], None],
    build_lidar: Callable[[], LidarScene] | None = None,
) -> LearnedInstances:
    """Learn one codeword per object by votes (an `InstanceLearner`); a moving object is one by its track.

    `build_lidar` finds the things of the drive in its sweeps, and is called where masks leave something out.
    """
    on_note(f"looking at the masks of {sum(photo.has_masks for photo in store.facts)} photos")
    observed = measure_mask_weights(model, store, config.instances.min_alpha)
    observed = observed.silence(find_model_shadows(model))  # a mask shows what a shadow falls on
    means = model.parameters["means"].detach().numpy()
    masks = len(observed.view_of_mask)
    silence = measure_silence(observed, model.nodes == 0)
    shown, seen_by_lidar = observed.sum_shown(), None
    if build_lidar is not None and silence >= config.graph.min_silence:
        on_note(f"{silence / (1 + silence):.0%} of what the photos show is in no mask: LiDAR has a say in it")
        lidar = build_lidar()
        things = assign_lidar_things(means, model.nodes, lidar, config.graph.lidar_reach)
        observed = add_lidar_masks(observed, things, silence)
        seen_by_lidar = lidar.ground, things
    groups = _first_groups(observed, means, model.nodes, config.graph)
    groups = vote_groups(observed, groups, model.nodes > 0, config.graph, config.graph.get_majority(silence))
    opacities = sigmoid(model.parameters["opacity_logits"].detach().numpy())
    reaches = find_reaches(groups, means, opacities, model.nodes, model.tracks())
    strays = find_strays(groups, means, model.nodes, reaches)
    if strays.any():
        groups = give_strays_away(groups, strays, means, compute_vote_shares(observed, groups), reaches)
    if config.graph.max_unmasked < 1:
        groups = _refill_unmasked(groups, observed, model, config.graph)
    groups = fill_from_nearest(groups, means, model.nodes)
    if seen_by_lidar is not None:
        groups = mend_ground(groups, shown, model, *seen_by_lidar)
        groups = join_upper_pieces(groups, shown, model.nodes, means, _compute_normals(model), seen_by_lidar[0])
    shares = compute_vote_shares(observed, groups)
    groups = fill_compact_objects(groups, means, opacities, model.nodes == 0, shares, shown)
    _, groups = np.unique(groups, return_inverse=True)
    codes, bits = generate_separated_codewords(int(groups.max()) + 1)
    on_note(f"{masks:,} masks show {len(codes)} objects: codewords of {bits} bits")
    codewords = codes[groups]
    return LearnedInstances(codewords, _FEATURE * decode_codewords(codewords, bits), bits, whole=True)


def _refill_unmasked(
    groups: Int64[ndarray, " n"], observed: MaskWeights, model: SceneModel, config: GraphConfig
) -> Int64[ndarray, " n"]:
    """Ask neighbours that look alike where hardly any mask speaks: stray weight of masks nearby would decide else."""
    unknown = (observed.compute_unmasked_shares() > config.max_unmasked) & (model.nodes == 0)
    means, colors = (model.parameters[name].detach().numpy() for name in ("means", "sh_dc"))
    return fill_from_similar(
        groups, unknown, means, color_from_dc(colors), _compute_normals(model), model.nodes, config.similar_neighbors
    )


def _compute_normals(model: SceneModel) -> Float64[ndarray, "n 3"]:
    return compute_normals(*(model.parameters[name].detach().numpy() for name in ("quats", "log_scales")))


def _first_groups(observed: MaskWeights, means: ndarray, nodes: ndarray, config: GraphConfig) -> Int64[ndarray, " n"]:
    """Merged patches of the background, then one group per moving object; -1 where nothing was seen."""
    groups = np.full(len(means), -1, np.int64)
    rows = np.flatnonzero((observed.sum_weights() >= config.min_weight) & (nodes == 0))
    if len(rows) > 1:
        pairs = find_neighbor_pairs(means[rows], config.neighbors)
        patches = join_superpoints(observed, pairs, config, rows)
        groups[rows] = merge_groups(observed, patches, pairs, config, rows)
    on_actor = nodes > 0
    groups[on_actor] = groups.max(initial=-1) + nodes[on_actor].astype(np.int64)
    return np.where(groups >= 0, np.unique(groups, return_inverse=True)[1] - int((groups < 0).any()), -1)
