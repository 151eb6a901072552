"""A tiny scene of three clusters, photographed by the rasterizer itself, and a trainer on it."""

from dataclasses import replace

import numpy as np

from instdrive_core.rasterize.render import render
from instdrive_core.scene.camera import Camera, look_at
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.training.backends.backend import Backend
from instdrive_core.training.backends.cpu_backend import CpuBackend
from instdrive_core.training.gaussians.model import build_model
from instdrive_core.training.settings.config import TrainConfig, build_train_config
from instdrive_core.training.trainer import Trainer
from instdrive_core.training.views.training_view import TrainingView
from instdrive_core.training.views.view_store import ViewStore

OBJECTS = np.array([[-2.0, 6, 0.5], [2.0, 6, 0.5], [0, 9, 0.5]])
COLORS = np.array([[0.9, 0.2, 0.1], [0.1, 0.7, 0.2], [0.2, 0.3, 0.9]])


def blobs(rng: np.random.Generator, count: int = 120) -> tuple[Gaussians, np.ndarray]:
    """Three clusters of small Gaussians; returns them and each one's object number from 1."""
    which = np.repeat(np.arange(3), count // 3)
    means = OBJECTS[which] + rng.uniform(-0.6, 0.6, (len(which), 3))
    size = len(which)
    return (
        Gaussians(
            means=means.astype(np.float32),
            quats=np.tile(np.array([1, 0, 0, 0], np.float32), (size, 1)),
            log_scales=np.full((size, 3), np.log(0.18), np.float32),
            opacity_logits=np.full(size, 2.0, np.float32),
            sh_dc=((COLORS[which] - 0.5) / 0.28209479).astype(np.float32),
            sh_rest=np.zeros((size, 3, 3), np.float32),
            features=rng.normal(0, 0.1, (size, 4)).astype(np.float32),
        ),
        which + 1,
    )


def photographed(gaussians: Gaussians, which: np.ndarray, seed: int) -> list[TrainingView]:
    """Four photos with shuffled masks."""
    rng = np.random.default_rng(seed)
    views = []
    for number, x in enumerate((-1.5, -0.5, 0.5, 1.5)):
        pose = look_at(np.array([x, 0, 1.2]), np.array([0, 7.0, 0.5]))
        camera = Camera(60.0, 60.0, 32.0, 24.0, 64, 48, pose)
        colors = 0.5 + 0.28209479 * gaussians.sh_dc
        owner = np.eye(3, dtype=np.float32)[which - 1]
        raster = render(
            gaussians.means,
            gaussians.quats,
            gaussians.log_scales,
            gaussians.opacities,
            np.concatenate([colors, owner], axis=1).astype(np.float32),
            camera,
        )
        labels = rng.permutation(3)[raster.image[..., 3:].argmax(axis=2)] + 1
        labels = np.where(raster.alpha > 0.5, labels, 0).astype(np.uint16)
        image = raster.image[..., :3] + 0.6 * (1 - raster.alpha[..., None])
        known = np.flatnonzero(raster.alpha > 0.9).astype(np.int32)
        depth = (raster.depth / np.maximum(raster.alpha, 1e-6)).ravel()[known].astype(np.float32)
        photo = (image.clip(0, 1) * 255).round().astype(np.uint8)
        sky = raster.alpha < 0.01
        views.append(
            TrainingView(f"front_camera/{number:02d}", camera, 0.1 * number, photo, None, labels, sky, known, depth)
        )
    return views


def tiny_config(schedule: str = "after") -> TrainConfig:
    config = build_train_config("instdrive" if schedule == "after" else "paper", "demo", seed=3)
    return replace(
        config,
        geometry=replace(config.geometry, iterations=30, coarse_iterations=8, sky_resolution=8),
        instances=replace(config.instances, learned_by="losses", iterations=60, feature_dim=4, pixels_per_view=300),
        checkpoint_every=20,
        report_every=5,
    )


def new_trainer(config: TrainConfig, backend: Backend | None = None, harmonics: int = 3) -> tuple[Trainer, np.ndarray]:
    """A trainer on the photos of the clusters, and each Gaussian's object; `harmonics` beside the constant one."""
    rng = np.random.default_rng(0)
    truth, which = blobs(rng)
    views = photographed(truth, which, 1)
    start = truth.copy()
    start.sh_rest = np.zeros((len(which), harmonics, 3), np.float32)
    start.features = start.features[:, : config.trained_feature_dim]
    start.sh_dc += rng.normal(0, 0.6, start.sh_dc.shape).astype(np.float32)
    sky = np.full((6, 8, 8, 3), 0.5, np.float32)
    model = build_model(start, np.zeros(len(which), np.uint16), (), sky, [view.time for view in views])
    store = ViewStore.from_views(views)
    return Trainer(model, store, config, scene_radius=10.0, backend=backend or CpuBackend()), which
