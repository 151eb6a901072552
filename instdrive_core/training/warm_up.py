"""The first start on a machine compiles the kernels; later ones read them from a cache. This does it, and says so."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from instdrive_core.scene.camera import Camera, look_at
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.track import Track
from instdrive_core.training.config import TrainConfig, train_config
from instdrive_core.training.model import model_from_gaussians
from instdrive_core.training.trainer import Trainer
from instdrive_core.training.view_store import ViewStore
from instdrive_core.training.views import TrainingView

_PATIENCE = 2.0
"""Seconds of silence: reading cached kernels takes less."""


def compile_kernels(on_note: Callable[[str], None]) -> None:
    """Take one step of each stage on a scene of a few Gaussians, so that no later step waits for the compiler."""
    message = "compiling the kernels for this machine (once, about a minute; they are kept for later runs)"
    timer = threading.Timer(_PATIENCE, on_note, (message,))
    timer.daemon = True
    timer.start()
    try:
        trainer = _small_trainer()
        trainer.rgb_step()
        trainer.stage = "instances"
        trainer.instance_step()
    finally:
        timer.cancel()


def _small_trainer() -> Trainer:
    rng, count = np.random.default_rng(0), 64
    gaussians = Gaussians(
        means=rng.uniform([-2, 4, -1], [2, 8, 1], (count, 3)).astype(np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        log_scales=np.full((count, 3), -1, np.float32),
        opacity_logits=np.zeros(count, np.float32),
        sh_dc=np.zeros((count, 3), np.float32),
        sh_rest=np.zeros((count, 3, 3), np.float32),
        features=rng.normal(0, 0.1, (count, 4)).astype(np.float32),
    )
    nodes = np.repeat(np.array([0, 1], np.uint16), count // 2)
    pose = np.eye(4)[None]
    track = Track("warm-up", "Car", np.array([2.0, 4.0, 2.0]), np.zeros(1), pose, True)
    model = model_from_gaussians(gaussians, nodes, (track,), np.full((6, 4, 4, 3), 0.5, np.float32), (0.0,))
    return Trainer(model, ViewStore.of([_small_view()]), _small_config(), 10.0)


def _small_view() -> TrainingView:
    height, width = 32, 48
    camera = Camera(40.0, 40.0, 24.0, 16.0, width, height, look_at(np.zeros(3), np.array([0, 6.0, 0])))
    labels = np.repeat(np.arange(1, 3, dtype=np.uint16), width // 2)[None].repeat(height, axis=0)
    sky = np.zeros((height, width), bool)
    sky[:4] = True
    pixels = np.arange(200, 400, dtype=np.int32)
    return TrainingView(
        key="warm-up/00",
        camera=camera,
        time=0.0,
        image=np.full((height, width, 3), 128, np.uint8),
        valid=np.ones((height, width), bool),
        labels=np.ascontiguousarray(labels),
        sky=sky,
        depth_pixels=pixels,
        depth_values=np.full(len(pixels), 6, np.float32),
    )


def _small_config() -> TrainConfig:
    config = train_config()
    return replace(
        config,
        geometry=replace(config.geometry, coarse_iterations=0),
        instances=replace(config.instances, feature_dim=4, pixels_per_view=200),
    )
