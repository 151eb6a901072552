"""Held-out PSNR over time: how long a real clip takes to a quality.

`python -m benchmarks.time_to_quality CLIP` trains the RGB stage of the quick preset and stops
the clock now and then to draw held-out photos. It prints one JSON line; seconds count reading the clip as well.
`--config.geometry.coarse-iterations 0` and the like change one setting.
"""

from __future__ import annotations

import dataclasses
import json
import resource
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numba
import numpy as np
import torch
import tyro
from tyro.conf import Positional

from instdrive_core.datasets.clip import Clip, ClipOptions
from instdrive_core.datasets.registry import load_clip
from instdrive_core.errors import InstDriveError
from instdrive_core.evaluation.metrics.box_pixels import find_moving_box_pixels
from instdrive_core.evaluation.metrics.image_metrics import psnr
from instdrive_core.masks.label_map_folder import MaskFolder, open_masks
from instdrive_core.rasterize.scene_view import view_scene
from instdrive_core.scene.exposure import apply_exposure
from instdrive_core.scene.scene import Scene
from instdrive_core.training.backends.cpu_backend import CpuBackend
from instdrive_core.training.build_trainer import build_trainer_from_clip
from instdrive_core.training.gaussians.exposures import export_exposures
from instdrive_core.training.instances.scene_export import export_trained_scene
from instdrive_core.training.settings.config import TrainConfig, build_train_config
from instdrive_core.training.trainer import Trainer
from instdrive_core.training.views.view_store import open_view_store
from instdrive_core.training.warm_up import compile_kernels


@dataclass(frozen=True)
class Options:
    """Train a clip and draw its held-out photos now and then."""

    clip: Positional[Path]
    masks: Path | None = None
    """Folder of masks, of which the RGB stage uses the sky; default: the clip's own `masks/`, else none."""
    options: ClipOptions = dataclasses.field(default_factory=ClipOptions)
    config: TrainConfig = dataclasses.field(default_factory=build_train_config)
    marks: int = 10
    """How often held-out photos are drawn, evenly over the steps."""
    photos: int = 18
    """Held-out photos drawn each time but the last, which draws all; evenly chosen."""


@dataclass(frozen=True)
class Quality:
    """Mean PSNR over photos, dB."""

    psnr: float
    psnr_actors: float | None


def quality(scene: Scene, clip: Clip, photos: int) -> Quality:
    """Compare held-out photos with the scene."""
    frames = clip.with_cameras(scene.views).held_out_frames
    chosen = np.unique(np.linspace(0, len(frames) - 1, min(photos, len(frames))).round().astype(int))
    whole, actors = [], []
    for frame in (frames[number] for number in chosen):
        camera, moment = frame.view.camera, frame.view.time
        image = view_scene(scene, camera, moment).color
        if scene.exposures is not None:
            image = apply_exposure(image, scene.exposures.interpolate(frame.view.name, moment))
        photo = frame.load_image().astype(np.float32) / 255
        valid = np.ones(photo.shape[:2], bool) if frame.valid is None else frame.valid
        whole.append(psnr(np.clip(image, 0, 1), photo, valid))
        actors.append(psnr(np.clip(image, 0, 1), photo, valid & find_moving_box_pixels(camera, clip.tracks, moment)))
    known = [value for value in actors if value is not None]
    return Quality(
        float(np.mean([value for value in whole if value is not None])), float(np.mean(known)) if known else None
    )


def build_scene(trainer: Trainer, clip: Clip) -> Scene:
    """What has been learned so far, without instances."""
    exposures = None
    if trainer.config.geometry.exposure_lr:
        exposures = export_exposures(trainer.model.shared["exposures"], trainer.store.facts)
    return export_trained_scene(trainer.model, clip, trainer.config, None, exposures, trainer.cameras)


def main(options: Options) -> dict[str, object]:
    """Everything the JSON line says."""
    torch.set_num_threads(1)  # as training does
    compile_kernels(lambda note: print(note, file=sys.stderr))
    started, drawing = time.perf_counter(), 0.0
    clip = load_clip(str(options.clip), options.options)
    folder = options.masks or options.clip / "masks"
    masks: MaskFolder | None = open_masks(folder) if options.masks or folder.is_dir() else None
    total = options.config.geometry.iterations
    due = set(np.linspace(0, total, options.marks + 1).round().astype(int).tolist()[1:])
    curve: list[tuple[int, float, float, int]] = []
    psnr_actors: float | None = None
    with open_view_store(clip, masks) as store:
        trainer = build_trainer_from_clip(options.config, clip, store, CpuBackend())
        ready = time.perf_counter() - started
        while trainer.iteration < total:
            trainer.rgb_step()
            trainer.after_rgb_step()
            trainer.iteration += 1
            if trainer.iteration in due:
                before = time.perf_counter()
                photos = options.photos if trainer.iteration < total else 1_000_000
                reached = quality(build_scene(trainer, clip), clip, photos)
                drawing += time.perf_counter() - before
                seconds = time.perf_counter() - started - drawing
                psnr_actors = reached.psnr_actors
                curve.append((trainer.iteration, round(seconds, 1), round(reached.psnr, 3), len(trainer.model)))
                print(*curve[-1], file=sys.stderr, flush=True)
    return {
        "clip": clip.name,
        "iterations": total,
        "threads": numba.get_num_threads(),
        "ready_s": round(ready, 1),
        "seconds": curve[-1][1],
        "psnr": curve[-1][2],
        "psnr_actors": psnr_actors and round(psnr_actors, 3),
        "gaussians": len(trainer.model),
        "peak_rss_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024),
        "curve": curve,
    }


if __name__ == "__main__":
    try:
        print(json.dumps(main(tyro.cli(Options))))
    except InstDriveError as error:
        sys.exit(str(error))
