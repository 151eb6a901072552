"""Trains a clip with the ``demo`` preset, colour and shape only, and measures its held-out photos."""

from __future__ import annotations

from pathlib import Path

from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.evaluation.protocol import evaluate_run
from instdrive_core.training.run import RunRequest, run_training
from instdrive_core.training.settings.config import build_train_config


def train_for_psnr(clip: Path, options: ClipOptions, run: Path) -> float:
    """Train into the folder `run`; mean PSNR of held-out photos in dB."""
    request = RunRequest(clip, run, options, build_train_config("instdrive", "demo"))
    run_training(request, lambda event: None, lambda note: None)
    found = evaluate_run(run).figures["psnr"]
    assert isinstance(found, float)
    return found
