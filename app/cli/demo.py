"""`instdrive demo`: everything from clip to edited scene, on a synthetic drive."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from rich.console import Console
from tyro.conf import arg

from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.datasets.synthetic.config import StreetConfig
from instdrive_core.training.settings.config import TrainConfig, build_train_config


def demo(out: Annotated[Path, arg(aliases=["-o"])] = Path("runs/demo"), seed: int = 7, script: bool = False) -> None:
    """Train a synthetic drive, evaluate it, and open the editor on it.

    Args:
        out: Folder for clip, run and pictures; what is already there is used again.
        seed: Random seed of the synthetic street.
        script: Play a scripted session instead of opening the window; without a display that is always done.
    """
    run = prepare_run(out, StreetConfig(seed=seed), build_train_config("instdrive", "demo"), Console())
    has_display = bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
    if script or not has_display:
        play(run, out)
    else:
        from instdrive_app.cli.edit import edit

        edit(run)


@dataclass(frozen=True)
class _Step:
    """One part of the demo, and the file whose existence shows that it is complete."""

    title: str
    result: Path
    work: Callable[[], None]


def prepare_run(out: Path, street: StreetConfig, config: TrainConfig, console: Console) -> Path:
    """Make clip, masks, run and evaluation under `out`, each only where it is missing; returns the run's folder."""
    clip, run, report = out / "clip", out / "run", out / "eval.json"
    steps = (
        _Step("synthetic drive", clip / "meta" / "gps.json", lambda: _record(clip, street)),
        _Step("masks", clip / "masks" / "masks.json", lambda: _mask(clip)),
        _Step("training (a first run also compiles kernels)", run / "run.json", lambda: _train(clip, run, config)),
        _Step("evaluation", report, lambda: _evaluate(run, report)),
    )
    for step in steps:
        if step.result.exists():
            console.print(f"[dim]{step.title}: already there[/dim]")
            continue
        console.rule(step.title, align="left")
        started = time.perf_counter()
        step.work()
        console.print(f"[green]{step.title}: {time.perf_counter() - started:.0f} s[/green]")
    return run


def play(run: Path, out: Path) -> None:
    """Play a scripted session in the editor; pictures and the edited scene go into `out`."""
    from instdrive_app.demo.script import run_scripted_session

    run_scripted_session(run, out)
    session = json.loads((out / "session.json").read_text())
    print(f"pictures, edited.ply and session.json are in {out}; clicked: {session['picked_name']}")


def _record(clip: Path, street: StreetConfig) -> None:
    from instdrive_core.cli.synth import record_synthetic_drive

    record_synthetic_drive(clip, street.seed, street.steps, street.width, street.height)


def _mask(clip: Path) -> None:
    from instdrive_core.cli.masks import create_masks

    create_masks(clip, "exact")


def _train(clip: Path, run: Path, config: TrainConfig) -> None:
    from instdrive_core.cli.train_progress import train_with_progress
    from instdrive_core.training.run import CHECKPOINT, RunRequest

    train_with_progress(RunRequest(clip, run, ClipOptions(), config, resume=(run / CHECKPOINT).exists()))


def _evaluate(run: Path, report: Path) -> None:
    from instdrive_core.cli.eval import evaluate

    evaluate(run, report)
