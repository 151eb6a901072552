"""A trainer that begins where a finished scene ended."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Bool, Float32, Int64
from numpy import ndarray

from instdrive_core.scene.scene import Scene
from instdrive_core.training.backends.backend import Backend
from instdrive_core.training.build_trainer import make_uniform_sky, move_views
from instdrive_core.training.gaussians.edit_guard import EditGuard
from instdrive_core.training.gaussians.first_gaussians import compute_mean_sky_color, compute_scene_radius
from instdrive_core.training.gaussians.lineage import Lineage
from instdrive_core.training.gaussians.model import SceneModel, build_model
from instdrive_core.training.settings.config import TrainConfig
from instdrive_core.training.trainer import Trainer
from instdrive_core.training.views.view_store import ViewStore


def build_improving_trainer(
    config: TrainConfig, scene: Scene, store: ViewStore, edited: Bool[ndarray, " n"], backend: Backend
) -> Trainer:
    """Build a trainer with a finished scene's Gaussians, sky, tracks, cameras and exposures.

    Rows that the user edited keep their bits, see `EditGuard`.

    Args:
        config: as `build_improving_config` makes it.
        scene: the finished scene without edits; features are carried along untrained.
        store: the photos that it was trained on.
        edited: rows that the user deleted, moved or recoloured.
        backend: trains.
    """
    trainer = Trainer(_build_start(scene, store), store, config, compute_scene_radius(store), backend)
    trainer.cameras.start_from(move_views(scene, scene.origin))
    trainer.lineage = Lineage.begin(order_by_node(scene))
    trainer.guard = _build_guard(trainer, scene, edited, backend)
    return trainer


def _build_guard(trainer: Trainer, scene: Scene, edited: Bool[ndarray, " n"], backend: Backend) -> EditGuard | None:
    if not edited.any():
        return None
    start, rows = _build_start(scene, trainer.store), order_by_node(scene)
    return EditGuard(start, backend, edited, rows, trainer.cameras.list_poses())


def order_by_node(scene: Scene) -> Int64[ndarray, " n"]:
    """Order a scene's rows as models have them: background first, then actor by actor."""
    return np.argsort(scene.nodes, kind="stable")


def _build_start(scene: Scene, store: ViewStore) -> SceneModel:
    order = order_by_node(scene)
    sky = make_uniform_sky(compute_mean_sky_color(store), 8) if scene.sky is None else scene.sky.faces
    model = build_model(scene.gaussians.select(order), scene.nodes[order], scene.actors, sky, store.times)
    if scene.exposures is not None:
        _start_exposures(model, store, dict(zip(scene.exposures.keys, scene.exposures.matrices, strict=True)))
    return model


@torch.no_grad()
def _start_exposures(model: SceneModel, store: ViewStore, known: dict[str, Float32[ndarray, "3 4"]]) -> None:
    for number, photo in enumerate(store.facts):
        if photo.key in known:
            model.shared["exposures"][number] = torch.from_numpy(known[photo.key].copy())
