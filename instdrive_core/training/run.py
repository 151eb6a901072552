"""A training run as a folder: config, log, checkpoint, and at the end the scene that the editor opens."""

from __future__ import annotations

import json
import resource
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float32
from numpy import ndarray

from instdrive_core.datasets.clip import Clip, ClipOptions, load_clip
from instdrive_core.datasets.sweeps import SweepCache
from instdrive_core.errors import DataError, OptionError
from instdrive_core.formats.atomic import write_bytes
from instdrive_core.formats.scene_folder import write_scene_folder
from instdrive_core.masks.labelmap import MaskFolder
from instdrive_core.masks.sources import ensure_masks
from instdrive_core.training.checkpoint import load_checkpoint, restore, save_checkpoint
from instdrive_core.training.config import TrainConfig
from instdrive_core.training.events import CheckpointDue, Event, StepDone
from instdrive_core.training.finish import finished_scene
from instdrive_core.training.initialize import initial_scene
from instdrive_core.training.model import SceneModel, model_from_gaussians
from instdrive_core.training.trainer import Trainer
from instdrive_core.training.views import TrainingView, training_view

CHECKPOINT, CONFIG, FACTS, LOG = "checkpoint.safetensors", "config.json", "run.json", "log.jsonl"
_MIN_SCENE_RADIUS = 10.0
"""Metres; keeps the means' learning rate sane where the car hardly moves."""


@dataclass(frozen=True)
class RunRequest:
    """What to train, from what, into which folder."""

    clip: Path
    out: Path
    options: ClipOptions
    config: TrainConfig
    masks: Path | None = None
    """Folder of masks; None = the clip's own, else `annotations` masks written into the run."""
    resume: bool = False


def run_training(request: RunRequest, on_event: Callable[[Event], None], on_note: Callable[[str], None]) -> Path:
    """Train a clip into `request.out` and return it.

    Raises OptionError where the folder already holds a run and `resume` is off, DataError for clips that cannot
    train, TrainingDivergedError where a loss is no longer finite.
    """
    out = request.out
    _check_output(request)
    out.mkdir(parents=True, exist_ok=True)
    on_note(f"reading {request.clip}")
    clip = load_clip(str(request.clip), request.options)
    if not clip.training_frames():
        raise DataError(request.clip, "no photo of a training time step was found", "Check cameras and frame range.")
    masks = ensure_masks(request.clip, clip, out, request.masks)
    on_note(
        f"{len(clip.training_frames())} training photos, {len(clip.held_out_frames())} held out; "
        + (f"masks: {masks.source}" if masks else "no masks: training RGB only")
    )
    views = training_views(clip, masks)
    trainer = _resumed(request, clip, views) if request.resume else _fresh(request.config, clip, views)
    _write_json(out / CONFIG, _config_facts(request, masks))
    with (out / LOG).open("a", encoding="utf-8") as log:
        for event in trainer.run():
            if isinstance(event, CheckpointDue):
                save_checkpoint(out / CHECKPOINT, trainer)
            if isinstance(event, StepDone):
                log.write(json.dumps(asdict(event)) + "\n")
                log.flush()
            on_event(event)
    on_note("naming instances and writing the scene")
    scene = finished_scene(trainer.model, clip, request.config, trainer.has_masks)
    write_scene_folder(out, scene)
    _write_json(out / FACTS, _facts(request, masks, trainer, len(scene.table)))
    return out


def training_views(clip: Clip, masks: MaskFolder | None) -> list[TrainingView]:
    """Every training photo with LiDAR depth of its time step and its masks; held-out sweeps are never touched."""
    sweeps = SweepCache(clip, held_out=False)
    views = []
    for frame in clip.training_frames():
        found = masks.load(frame) if masks else None
        labels, sky = (found.labels, found.sky) if found else (None, None)
        views.append(training_view(frame, sweeps.points_at(frame.view.index), labels, sky))
    return views


def scene_radius(views: list[TrainingView]) -> float:
    """Largest distance of a camera from the cameras' mean position, at least 10 m."""
    centers = np.stack([view.camera.position for view in views])
    return max(_MIN_SCENE_RADIUS, float(np.linalg.norm(centers - centers.mean(axis=0), axis=1).max()))


def mean_sky_color(views: list[TrainingView]) -> Float32[ndarray, "3"]:
    """What the sky looks like where no photo shows it: the mean over the sky masks, light grey without any."""
    pixels = [view.image[view.sky][::16] for view in views if view.sky is not None]
    seen = np.concatenate(pixels) if pixels else np.zeros((0, 3), np.uint8)
    return (seen.mean(axis=0) / 255 if len(seen) else np.full(3, 0.6)).astype(np.float32)


def _check_output(request: RunRequest) -> None:
    has_run = (request.out / CONFIG).exists()
    if request.resume and not (request.out / CHECKPOINT).exists():
        raise OptionError(f"{request.out}: no checkpoint to resume from. Leave --resume out to start a run.")
    if has_run and not request.resume:
        raise OptionError(f"{request.out}: already holds a run. Add --resume to go on, or choose another --out.")


def _fresh(config: TrainConfig, clip: Clip, views: list[TrainingView]) -> Trainer:
    start = initial_scene(clip, views, config.init, config.geometry.sh_degree, config.seed)
    dim = config.instances.feature_dim
    features = np.random.default_rng((config.seed, 3)).normal(0, config.instances.init_std, (len(start.nodes), dim))
    start.gaussians.features = features.astype(np.float32)
    resolution = config.geometry.sky_resolution
    sky = np.broadcast_to(mean_sky_color(views), (6, resolution, resolution, 3))
    model = model_from_gaussians(start.gaussians, start.nodes, start.actors, sky)
    return Trainer(model, views, config, scene_radius(views))


def _resumed(request: RunRequest, clip: Clip, views: list[TrainingView]) -> Trainer:
    path = request.out / CHECKPOINT
    checkpoint = load_checkpoint(path)
    if checkpoint.config != request.config:
        raise OptionError(
            f"{path}: was trained with other options than those given. Repeat the run's own ({request.out / CONFIG}), "
            "or choose another --out."
        )
    tracks = {track.id: track for track in clip.tracks}
    missing = [actor for actor in checkpoint.actor_ids if actor not in tracks]
    if missing:
        raise DataError(path, f"track {missing[0]} is not in the clip", "Resume with the clip that the run began with.")
    parameters = {name: value.clone().requires_grad_(True) for name, value in checkpoint.parameters().items()}
    model = SceneModel(parameters, checkpoint.nodes, tuple(tracks[actor] for actor in checkpoint.actor_ids))
    trainer = Trainer(model, views, request.config, checkpoint.scene_radius)
    restore(trainer, checkpoint)
    return trainer


def _config_facts(request: RunRequest, masks: MaskFolder | None) -> dict[str, Any]:
    return {
        "clip": str(request.clip.resolve()),
        **asdict(request.options),
        "masks": masks.source if masks else None,
        "train": request.config.to_json(),
    }


def _facts(request: RunRequest, masks: MaskFolder | None, trainer: Trainer, instances: int) -> dict[str, Any]:
    config = request.config
    return {
        "version": 1,
        "clip": str(request.clip.resolve()),
        **asdict(request.options),
        "masks": masks.source if masks else None,
        "method": config.method,
        "preset": config.preset,
        "seed": config.seed,
        "iterations": config.geometry.iterations + config.instance_iterations,
        "train_seconds": round(trainer.seconds, 1),
        "peak_rss_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024),
        "backend": "cpu",
        "threads": torch.get_num_threads(),
        "n_gaussians": len(trainer.model),
        "n_instances": instances,
    }


def _write_json(path: Path, values: dict[str, Any]) -> None:
    write_bytes(path, (json.dumps(values, indent=1) + "\n").encode())
