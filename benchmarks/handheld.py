"""How photos without LiDAR or points train, held-out photos against those that trained.

`python -m benchmarks.handheld` ray-traces 50 photos around a parked car of a synthetic street and 50 of a walk past it,
writes them with their poses alone, trains and evaluates. Prints one JSON line: PSNR (dB) of held-out photos for each
clip and their median, the last PSNR of training photos, and seconds of training.
"""

from __future__ import annotations

import json
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

from benchmarks.handheld_photos import KINDS, write_handheld_photos
from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.evaluation.protocol import evaluate_run
from instdrive_core.training.run import FACTS, LOG, RunRequest, run_training
from instdrive_core.training.settings.clip_size import AskedSizes
from instdrive_core.training.settings.config import Preset, build_train_config


@dataclass(frozen=True)
class Options:
    """Ray-trace, train, evaluate."""

    seeds: tuple[int, ...] = (92, 93)
    """Streets; nothing was chosen on these."""
    photos: int = 50
    preset: Preset = "quick"
    iterations: int | None = None
    """Steps of training; default: the preset's."""
    folder: Path | None = None
    """Where photos and runs are kept, and taken from where they are there; default: a temporary folder."""


def main(options: Options) -> dict[str, object]:
    """Everything the JSON line says."""
    clips: dict[str, dict[str, float]] = {}
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.folder or Path(temporary)
        for seed in options.seeds:
            for kind in KINDS:
                name = f"{kind}-{seed}"
                print(name, file=sys.stderr, flush=True)
                clips[name] = _measure(options, folder / name, kind, seed)
    return {"psnr": round(float(np.median([clip["psnr"] for clip in clips.values()])), 2), "clips": clips}


def _measure(options: Options, folder: Path, kind: str, seed: int) -> dict[str, float]:
    clip, run = folder / "clip", folder / "run"
    if not clip.is_dir():
        write_handheld_photos(clip, kind, seed, options.photos)
    if not (run / FACTS).is_file():
        config, sizes = build_train_config("instdrive", options.preset, 0), AskedSizes(options.iterations)
        request = RunRequest(clip, run, ClipOptions(scale=1.0), config, resume=run.is_dir(), sizes=sizes)
        run_training(request, lambda event: None, lambda note: print(note, file=sys.stderr, flush=True))
    last = json.loads((run / LOG).read_text().splitlines()[-1])
    figures = evaluate_run(run).figures
    return {
        "psnr": round(float(figures["psnr"]), 2),
        "training_psnr": round(float(last["psnr"]), 2),
        "seconds": round(float(last["seconds"])),
    }


if __name__ == "__main__":
    print(json.dumps(main(tyro.cli(Options))))
