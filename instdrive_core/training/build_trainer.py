"""Three ways to a trainer: from a clip, from a scene trained before, from a checkpoint."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float32, Float64
from numpy import ndarray

from instdrive_core.datasets.clip import Clip
from instdrive_core.errors import DataError, OptionError
from instdrive_core.formats.registry import open_scene
from instdrive_core.maths.streams import Stream, make_generator
from instdrive_core.scene.camera import CameraView
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.pose_transforms import transform_view
from instdrive_core.scene.scene import Scene
from instdrive_core.training.backends.backend import Backend
from instdrive_core.training.checkpoint import Checkpoint, restore_trainer
from instdrive_core.training.gaussians.first_gaussians import (
    build_initial_scene,
    compute_mean_sky_color,
    compute_scene_radius,
)
from instdrive_core.training.gaussians.model import build_model
from instdrive_core.training.settings.config import TrainConfig
from instdrive_core.training.trainer import Trainer
from instdrive_core.training.trainer_world import move_to_clip_world
from instdrive_core.training.views.view_store import ViewStore


def build_trainer_from_clip(config: TrainConfig, clip: Clip, store: ViewStore, backend: Backend) -> Trainer:
    """Build a trainer whose first Gaussians come from the clip's LiDAR and photos."""
    start = build_initial_scene(
        clip, store, config.init, config.geometry.sh_degree, config.seed, moving_actors=config.init.moving_actors
    )
    gaussians = add_first_features(start.gaussians, config)
    sky = make_uniform_sky(compute_mean_sky_color(store), config.geometry.sky_resolution)
    model = build_model(gaussians, start.nodes, start.actors, sky, store.times)
    return Trainer(model, store, config, compute_scene_radius(store), backend)


def build_trainer_from_scene(
    config: TrainConfig, clip: Clip, store: ViewStore, path: Path, backend: Backend
) -> Trainer:
    """Build a trainer from the Gaussians, actors and sky of a scene file or run.

    A plain .ply is taken to be in the clip's world coordinates, a checkpoint of another trainer in that trainer's.

    Raises DataError where the scene cannot be opened or placed, or no camera of the clip sees it.
    """
    scene = move_to_clip_world(open_scene(path), path, clip)
    gaussians = add_first_features(move_to_origin(scene, clip.origin), config)
    if not is_any_visible(gaussians.means[scene.nodes == 0], store):
        raise DataError(
            path,
            f"none of its {len(scene):,} Gaussians lies before a camera of {clip.path}",
            "The scene must be in the clip's world coordinates, in metres; give --init a scene of this clip",
        )
    sky = (
        scene.sky.faces
        if scene.sky
        else make_uniform_sky(compute_mean_sky_color(store), config.geometry.sky_resolution)
    )
    model = build_model(gaussians, scene.nodes, scene.actors, sky, store.times)
    trainer = Trainer(model, store, config, compute_scene_radius(store), backend)
    trainer.cameras.start_from(move_views(scene, clip.origin))
    return trainer


def resume_trainer(
    config: TrainConfig, store: ViewStore, path: Path, checkpoint: Checkpoint, backend: Backend
) -> Trainer:
    """Build a trainer that goes on exactly where the checkpoint at `path` was saved.

    Raises OptionError where the run was started with other options, DataError where the clip is another one.
    """
    if checkpoint.config != config:
        raise OptionError(
            f"{path}: was trained with other options than those given. Repeat the run's own "
            f"({path.parent / 'config.json'}), or choose another --out."
        )
    if checkpoint.photo_keys != tuple(photo.key for photo in store.facts):
        raise DataError(
            path, "the clip's training photos are not those of the run", "Resume with the clip and cameras of the run"
        )
    trainer = Trainer(checkpoint.model(store.times), store, config, checkpoint.scene_radius, backend)
    restore_trainer(trainer, checkpoint)
    return trainer


def add_first_features(gaussians: Gaussians, config: TrainConfig) -> Gaussians:
    """Copy the Gaussians with random features (N, d) in place of their own; d is `config.trained_feature_dim`."""
    shape = (len(gaussians), config.trained_feature_dim)
    features = make_generator(config.seed, Stream.FIRST_FEATURES).normal(0, config.instances.init_std, shape)
    return replace(gaussians, features=features.astype(np.float32))


def move_to_origin(scene: Scene, origin: Float64[ndarray, "3"]) -> Gaussians:
    """Copy the scene's Gaussians, moved to another origin; actors' Gaussians live in their boxes and stay."""
    gaussians = scene.gaussians.copy()
    shift = (scene.origin - origin).astype(np.float32)
    gaussians.means[scene.nodes == 0] += shift
    return gaussians


def move_views(scene: Scene, origin: Float64[ndarray, "3"]) -> tuple[CameraView, ...]:
    """Copy the scene's views, moved to another origin."""
    shift = np.column_stack([np.eye(3), scene.origin - origin])
    return tuple(transform_view(view, shift) for view in scene.views)


def is_any_visible(means: Float32[ndarray, "n 3"], store: ViewStore) -> bool:
    """Whether at least one point lies inside an image of the clip."""
    for photo in store.facts:
        pixels, depths = photo.camera.project(means)
        inside = (depths > 0.1) & (pixels > 0).all(axis=1)
        if np.any(inside & (pixels[:, 0] < photo.camera.width) & (pixels[:, 1] < photo.camera.height)):
            return True
    return False


def make_uniform_sky(color: Float32[ndarray, "3"], resolution: int) -> Float32[ndarray, "6 r r 3"]:
    """Make a cube map of one colour."""
    return np.broadcast_to(color, (6, resolution, resolution, 3)).astype(np.float32)
