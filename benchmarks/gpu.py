"""Training steps per second with and without instances: what the instance losses cost when they ride along.

`python -m benchmarks.gpu` measures the shared workload, `python -m benchmarks.gpu --clip CLIP --options.scale 1` a real
clip with its six cameras at full resolution; `--init SCENE` starts from a trained scene instead of LiDAR points. Steps
are the trainer's own, reading photos included, without growing and pruning. One JSON line.
"""

from __future__ import annotations

import dataclasses
import json
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
import torch
import tyro

from benchmarks.train_step import build_workload_model
from benchmarks.workload import load_workload
from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.datasets.registry import load_clip
from instdrive_core.errors import InstDriveError
from instdrive_core.masks.making import ensure_masks
from instdrive_core.scene.camera import Camera
from instdrive_core.training.backends.backend import Backend
from instdrive_core.training.backends.device import choose_backend
from instdrive_core.training.build_trainer import build_trainer_from_clip, build_trainer_from_scene
from instdrive_core.training.settings.config import Device, TrainConfig, build_train_config
from instdrive_core.training.trainer import Trainer
from instdrive_core.training.views.training_view import TrainingView
from instdrive_core.training.views.view_store import ViewStore, open_view_store

_BLOCKS = 6
"""The workload's photos are noise, with this many times this many masks."""


@dataclass(frozen=True)
class Options:
    """Time training steps with and without instances."""

    device: Device = "cuda"
    clip: Path | None = None
    """A clip in place of the shared workload."""
    init: Path | None = None
    """Scene file or run that a clip's training starts from."""
    options: ClipOptions = dataclasses.field(default_factory=ClipOptions)
    workload: Literal["W1", "W2", "W3"] = "W3"
    state: Literal["init", "trained"] = "trained"
    feature_dim: int = 16
    """Numbers of a Gaussian's instance feature."""
    steps: int = 200
    """Timed steps of each kind."""
    warm_up: int = 20
    """Steps before them."""


def build_config(feature_dim: int, with_instances: bool) -> TrainConfig:
    """The RGB stage at full resolution, spherical harmonics of degree 3, with or without the instance losses in it."""
    config = build_train_config("instdrive", "paper")
    return replace(
        config,
        geometry=replace(config.geometry, coarse_iterations=0),
        instances=replace(
            config.instances,
            learned_by="losses" if with_instances else "votes",
            schedule="joint" if with_instances else "after",
            feature_dim=feature_dim,
            pseudo_start=0.0,
        ),
    )


def workload_trainer(options: Options, config: TrainConfig, backend: Backend) -> Trainer:
    """The shared workload with photos of noise."""
    workload = load_workload(options.workload, options.state)
    model = build_workload_model(workload)
    features = np.random.default_rng(0).normal(0, 0.1, (len(model), options.feature_dim))
    model.parameters["features"] = torch.from_numpy(features.astype(np.float32))
    views = [noise_view(camera, number) for number, camera in enumerate(workload.cameras)]
    model.shared["exposures"] = torch.eye(3, 4).repeat(len(views), 1, 1).requires_grad_(True)
    return Trainer(model, ViewStore.from_views(views), config, scene_radius=50.0, backend=backend)


def noise_view(camera: Camera, number: int) -> TrainingView:
    """A photo in which nothing can be learned, cut into masks like a chess board."""
    rng = np.random.default_rng(number)
    image = rng.integers(0, 256, (camera.height, camera.width, 3)).astype(np.uint8)
    rows, columns = (
        np.arange(camera.height) * _BLOCKS // camera.height,
        np.arange(camera.width) * _BLOCKS // camera.width,
    )
    labels = (1 + rows[:, None] * _BLOCKS + columns).astype(np.uint16)
    nothing = np.zeros(0, np.int32), np.zeros(0, np.float32)
    return TrainingView(
        f"noise/{number:02d}", camera, 0.0, image, None, labels, rows[:, None] + 0 * columns < 1, *nothing
    )


def clip_trainer(options: Options, path: Path, config: TrainConfig, backend: Backend, folder: str) -> Trainer:
    """A clip's training photos and masks; `folder` keeps masks made from its annotations."""
    clip = load_clip(str(path), options.options)
    store = open_view_store(clip, ensure_masks(path, clip, folder, None))
    if options.init is not None:
        return build_trainer_from_scene(config, clip, store, options.init, backend)
    return build_trainer_from_clip(config, clip, store, backend)


def measure_steps_per_second(trainer: Trainer, warm_up: int, steps: int) -> float:
    """Training speed of the RGB stage, once photos have been read and kernels compiled."""
    start = 0.0
    for number in range(warm_up + steps):
        if number == warm_up:
            start = finish_run(trainer)
        trainer.rgb_step()
        trainer.iteration += 1
    return steps / (finish_run(trainer) - start)


def finish_run(trainer: Trainer) -> float:
    """The clock's time once the device has done all it was told."""
    if trainer.backend.device.type == "cuda":
        torch.cuda.synchronize(trainer.backend.device)
    return time.perf_counter()


def measure(options: Options) -> dict[str, object]:
    """Everything the JSON line says."""
    backend, rates, trainer = choose_backend(options.device), [], None
    with tempfile.TemporaryDirectory() as folder:
        for with_instances in (False, True):
            config = build_config(options.feature_dim, with_instances)
            if options.clip is None:
                trainer = workload_trainer(options, config, backend)
            else:
                trainer = clip_trainer(options, options.clip, config, backend, folder)
            with trainer.store:
                rates.append(measure_steps_per_second(trainer, options.warm_up, options.steps))
    assert trainer is not None
    camera = trainer.store.facts[0].camera
    return {
        "of": f"{options.workload} {options.state}" if options.clip is None else str(options.clip),
        "backend": backend.name,
        "device": device_name(backend.device),
        "torch": torch.__version__,
        "gaussians": len(trainer.model),
        "photos": len(trainer.store),
        "photo": f"{camera.width}x{camera.height}",
        "feature_dim": options.feature_dim,
        "steps_per_second_rgb": round(rates[0], 2),
        "steps_per_second_with_instances": round(rates[1], 2),
        "ratio": round(rates[1] / rates[0], 3),
        "peak_gpu_mb": peak_megabytes(backend.device),
    }


def device_name(device: torch.device) -> str:
    """What to call the device in a table."""
    return torch.cuda.get_device_name(device) if device.type == "cuda" else f"cpu, {torch.get_num_threads()} threads"


def peak_megabytes(device: torch.device) -> int | None:
    """Largest memory that tensors held on the device; None on a CPU."""
    return round(torch.cuda.max_memory_allocated(device) / 2**20) if device.type == "cuda" else None


if __name__ == "__main__":
    try:
        print(json.dumps(measure(tyro.cli(Options))))
    except InstDriveError as error:
        sys.exit(str(error))
