"""`instdrive demo`: the whole main job on a synthetic drive, from clip to edited scene."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

from rich.console import Console
from tyro.conf import arg


def demo(
    out: Annotated[Path, arg(aliases=["-o"])] = Path("runs/demo"), seed: int = 7, script: bool | None = None
) -> None:
    """Make a synthetic drive, train and evaluate it, and edit it.

    Args:
        out: Folder for clip, run and pictures; what is already there is used again.
        seed: Of the synthetic street.
        script: Play a scripted session instead of opening the window; default: only where there is no display.
    """
    console = Console()
    steps = Steps(console)
    clip, run = out / "clip", out / "run"
    steps.do("synthetic drive", (clip / "meta" / "gps.json").exists(), lambda: _synth(clip, seed))
    steps.do("masks", (clip / "masks" / "masks.json").exists(), lambda: _masks(clip))
    steps.do("training", (run / "run.json").exists(), lambda: _train(clip, run))
    steps.do("evaluation", (out / "eval.json").exists(), lambda: _evaluate(run, out / "eval.json", console))
    if script if script is not None else not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        steps.do("scripted editor session", False, lambda: _scripted(run, out))
    else:
        from instdrive_app.edit_command import edit

        edit(run)


class Steps:
    """Runs steps one after the other and says how long each took."""

    def __init__(self, console: Console) -> None:
        self.console = console

    def do(self, title: str, done: bool, work: Callable[[], None]) -> None:
        """Run `work` unless its result is already there."""
        if done:
            self.console.print(f"[dim]{title}: already there[/dim]")
            return
        self.console.rule(title, align="left")
        started = time.perf_counter()
        work()
        self.console.print(f"[green]{title}: {time.perf_counter() - started:.0f} s[/green]")


def _synth(clip: Path, seed: int) -> None:
    from instdrive_core.cli.synth import synth

    synth(clip, seed=seed)


def _masks(clip: Path) -> None:
    from instdrive_core.cli.masks import masks

    masks(clip, source="exact")


def _train(clip: Path, run: Path) -> None:
    from instdrive_core.cli.train import train
    from instdrive_core.datasets.clip import ClipOptions
    from instdrive_core.training.run import CHECKPOINT

    train(clip, run, preset="demo", options=ClipOptions(scale=1.0), resume=(run / CHECKPOINT).exists())


def _evaluate(run: Path, report: Path, console: Console) -> None:
    from instdrive_core.cli.eval import evaluate

    evaluate(run, json=report)


def _scripted(run: Path, out: Path) -> None:
    from instdrive_app.script import run_scripted_session

    run_scripted_session(run, out)
    session = json.loads((out / "session.json").read_text())
    print(f"pictures, edited.ply and eval.json are in {out} (clicked: {session.get('picked_name', '?')})")
