"""From trained features to a scene: codewords, spatial components, names."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float32, UInt16, UInt32
from numpy import ndarray

from instdrive_core.datasets.clip import Clip
from instdrive_core.instances.components import split_components
from instdrive_core.instances.id_assignment import number_by_size
from instdrive_core.instances.shadows import mark_learned_shadows
from instdrive_core.instances.table import build_instance_table
from instdrive_core.rasterize.sky_evidence import fill_scene_sky
from instdrive_core.scene.exposure import Exposures
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.sky import Sky
from instdrive_core.training.gaussians.camera_poses import CameraPoses
from instdrive_core.training.gaussians.first_shadows import find_model_shadows
from instdrive_core.training.gaussians.model import SceneModel
from instdrive_core.training.instances.instance_learner import LearnedInstances
from instdrive_core.training.instances.naming import find_instance_classes, make_display_names
from instdrive_core.training.settings.config import TrainConfig


def export_trained_scene(
    model: SceneModel,
    clip: Clip,
    config: TrainConfig,
    learned: LearnedInstances | None,
    exposures: Exposures | None,
    cameras: CameraPoses,
) -> Scene:
    """Export the editable scene. Without masks nothing was learned about instances: every ID is 0.

    Its views are the clip's, held-out ones included, where training found the cameras.
    """
    gaussians, actors = model.gaussians(), model.tracks()
    count = len(gaussians)
    codewords, ids = np.zeros(count, np.uint32), np.zeros(count, np.uint32)
    classes: dict[int, str] = {}
    if learned is not None:
        gaussians, codewords = replace(gaussians, features=learned.features), learned.codewords
        ids = _instance_ids(gaussians, model.nodes, learned, config)
        classes = find_instance_classes(clip, ids, gaussians.means, model.nodes, [actor.label for actor in actors])
    names = make_display_names(ids, classes)
    shadows = find_model_shadows(model)
    scene = Scene(
        gaussians=gaussians,
        instance_ids=ids,
        codewords=codewords,
        nodes=model.nodes,
        table=build_instance_table(ids, gaussians.means, codewords, model.nodes, names, classes, shadows),
        actors=actors,
        sky=Sky(model.shared["sky"].detach().cpu().numpy().clip(0, 1)),
        views=cameras.correct_views([frame.view for frame in clip.frames]),
        origin=clip.origin,
        exposures=exposures,
        code_bits=learned.code_bits if learned is not None else 0,
        extra=mark_learned_shadows(shadows),
    )
    return replace(scene, sky=fill_scene_sky(scene))


def _instance_ids(
    gaussians: Gaussians, nodes: UInt16[ndarray, " n"], learned: LearnedInstances, config: TrainConfig
) -> UInt32[ndarray, " n"]:
    if learned.whole:
        return number_by_size(learned.codewords.astype(np.int64))
    kinds = learned.codewords
    if config.instances.whole_actors:
        kinds = unify_actor_codewords(kinds, nodes, gaussians.opacities)
    return split_components(gaussians.means, gaussians.scales, nodes, kinds, gaussians.opacities)


def unify_actor_codewords(
    codewords: UInt32[ndarray, " n"], nodes: UInt16[ndarray, " n"], opacities: Float32[ndarray, " n"]
) -> UInt32[ndarray, " n"]:
    """Give each moving object's Gaussians the codeword with the largest summed opacity among them."""
    unified = codewords.copy()
    for node in np.unique(nodes[nodes > 0]).tolist():
        rows = np.flatnonzero(nodes == node)
        codes, inverse = np.unique(codewords[rows], return_inverse=True)
        unified[rows] = codes[np.argmax(np.bincount(inverse, weights=opacities[rows]))]
    return unified
