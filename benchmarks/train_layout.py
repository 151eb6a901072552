"""Trains a drive with the ``demo`` preset, colour and shape only, and measures its held-out photos."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool
from numpy import ndarray

from instdrive_core.datasets.clip import Clip, ClipOptions
from instdrive_core.datasets.registry import load_clip
from instdrive_core.evaluation.metrics.held_out import measure_held_out_view
from instdrive_core.formats.folder.scenes import read_scene_folder
from instdrive_core.masks.ground_truth import UnknownLabels
from instdrive_core.training.gaussians.model import SceneModel
from instdrive_core.training.instances.instance_learner import LearnedInstances
from instdrive_core.training.run import RunRequest, run_training
from instdrive_core.training.settings.clip_size import AskedSizes
from instdrive_core.training.settings.config import TrainConfig, build_train_config
from instdrive_core.training.views.view_store import ViewStore

Shown = Sequence[Bool[ndarray, "h w"] | None]
"""For each held-out photo the pixels that are compared; None = all."""


@dataclass(frozen=True)
class PartOfDrive:
    """A clip's folder, the part of it to train, and for how many steps."""

    path: Path
    options: ClipOptions
    iterations: int | None = None
    """None = the preset's."""

    def load(self) -> Clip:
        """Open it at the size that is trained."""
        return load_clip(str(self.path), self.options)


def train_for_psnr(part: PartOfDrive, runs: Path, shown: Shown, seeds: int = 1) -> list[float]:
    """Train into folders of `runs` with the masks that training makes itself; mean PSNR in dB of each seed.

    The pixels of `shown` are compared, whatever the part's own layout says of the recording car.
    """
    found = []
    for seed in range(seeds):
        run, config = runs / str(seed), build_train_config("instdrive", "demo", seed)
        sizes = AskedSizes(part.iterations)
        request = RunRequest(part.path, run, part.options, config, learner=_learn_nothing, sizes=sizes)
        run_training(request, lambda event: None, lambda note: None)
        found.append(measure_held_out_psnr(run, part.load(), shown))
    return found


def measure_held_out_psnr(run: Path, clip: Clip, shown: Shown) -> float:
    """Mean PSNR in dB of a run's held-out photos; `shown` as for `train_for_psnr`."""
    scene = read_scene_folder(run)
    frames = zip(clip.with_cameras(scene.views).held_out_frames, shown, strict=True)
    views = (measure_held_out_view(scene, clip, replace(frame, valid=kept), UnknownLabels()) for frame, kept in frames)
    return float(np.mean([view.psnr for view in views if view.psnr is not None]))


def _learn_nothing(
    model: SceneModel, store: ViewStore, config: TrainConfig, on_note: Callable[[str], None]
) -> LearnedInstances:
    """Take the place of learning instances, which changes no picture: all Gaussians are one."""
    count = len(model)
    return LearnedInstances(np.zeros(count, np.uint32), np.zeros((count, 0), np.float32), 0, whole=True)
