"""Does memory grow? Half an hour of scripted editing, or of training, in this process.

`python -m benchmarks.long_run editing --minutes 30` repeats a round of edits, moves of the camera, pictures, saving,
exporting and opening; `python -m benchmarks.long_run training CLIP --minutes 30` trains with the number of Gaussians
fixed. Each prints one JSON line: resident memory after the warm-up (the first fifth) and at the end, medians of many
readings, and the growth in percent.
"""

from __future__ import annotations

import gc
import json
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import psutil
import tyro
from tyro.conf import Positional

from benchmarks.own_state import own_state
from instdrive_core.errors import InstDriveError

WARM_SHARE, END_SHARE = 0.2, 0.1
"""Parts of the run: the first is passed over, the readings after it and those of the last are compared."""
SIZE = (1280, 720)


@dataclass(frozen=True)
class Editing:
    """Edit the sample scene, or another one."""

    scene: Path | None = None
    minutes: float = 30.0


@dataclass(frozen=True)
class Training:
    """Train a clip."""

    clip: Positional[Path]
    minutes: float = 30.0
    gaussians: int = 100_000
    """To start with, about; densification is off."""


class Finished(Exception):
    """The time is over."""


class Gauge:
    """Readings of resident memory over a run of some minutes."""

    def __init__(self, minutes: float) -> None:
        self._seconds = 60 * minutes
        self._started = time.monotonic()
        self.readings: list[tuple[float, float]] = []

    @property
    def over(self) -> bool:
        """Whether the time is up."""
        return time.monotonic() - self._started >= self._seconds

    def read(self) -> None:
        """Take one reading, with garbage collected."""
        gc.collect()
        share = (time.monotonic() - self._started) / self._seconds
        self.readings.append((share, resident_megabytes()))

    def result(self) -> dict[str, float]:
        """Medians and growth. Raises InstDriveError where the run was too short to tell."""
        first = [mb for share, mb in self.readings if WARM_SHARE <= share < WARM_SHARE + END_SHARE]
        last = [mb for share, mb in self.readings if share >= 1 - END_SHARE]
        if len(first) < 3 or len(last) < 3:
            raise InstDriveError(f"{len(self.readings)} readings are too few; give more --minutes")
        begin, end = statistics.median(first), statistics.median(last)
        return {
            "minutes": round(self._seconds / 60, 1),
            "readings": len(self.readings),
            "rss_mb_begin": round(begin, 1),
            "rss_mb_end": round(end, 1),
            "growth_percent": round(100 * (end / begin - 1), 2),
        }


def resident_megabytes() -> float:
    """Memory of this process that is in RAM now."""
    return psutil.Process().memory_info().rss / 2**20


def run_editing(options: Editing) -> dict[str, object]:
    """Rounds of what a user does; each ends where it began, so that what stays is a leak."""
    from benchmarks.editor_session import driven_editor
    from instdrive_app.files.sample import find_sample_scene
    from instdrive_app.render.offscreen import open_offscreen_context

    gauge, rounds = Gauge(options.minutes), 0
    with own_state() as folder, open_offscreen_context() as context, driven_editor(context, SIZE) as editor:
        scene = options.scene or find_sample_scene()
        editor.open(scene)
        rng = np.random.default_rng(0)
        while not gauge.over:
            _editing_round(editor, rng, folder, reopen=scene if rounds % 10 == 9 else None)
            rounds += 1
            gauge.read()
    return {"what": "editing", "rounds": rounds, **gauge.result()}


def _editing_round(editor, rng: np.random.Generator, folder: Path, reopen: Path | None) -> None:
    from instdrive_core.edits.kinds.duplicate import DuplicateInstances
    from instdrive_core.edits.kinds.move import MoveInstances

    session = editor.session
    visible = session.document.find_visible_instances()
    chosen = tuple(int(i) for i in rng.choice(visible, min(3, len(visible)), replace=False))
    acts: tuple[Callable[[], object], ...] = (
        lambda: session.selection.select(chosen),
        lambda: session.colors.recolor(chosen, "tint", tuple(rng.uniform(0, 1, 3))),
        lambda: session.history.apply(MoveInstances(chosen, (float(rng.uniform(-1, 1)), 0.5, 0.0))),
        lambda: session.history.apply(DuplicateInstances(chosen[:1], (0.0, 2.0, 0.0))),
        lambda: session.deletion.delete(chosen[:1]),
        lambda: session.navigation.look_through(int(rng.integers(len(session.document.scene.views) or 1))),
        session.history.undo,
        session.history.redo,
        lambda: session.files.save(folder / "long.instdrive"),
    )
    for act in acts:
        editor.frame(act)
        editor.settle()
    editor.frames_until(lambda: session.jobs.current is None)
    editor.export(folder / "long.ply")
    session.history.jump(0)
    editor.frames_until(lambda: not session.history.is_jumping)
    if reopen is not None:
        before = session.document
        session.files.open(reopen)
        editor.frames_until(lambda: session.document is not before)
    editor.settle()


def run_training(options: Training) -> dict[str, object]:
    """Steps of the RGB stage, then of nothing: the run is cut off when the time is over."""
    from instdrive_core.datasets.clip import ClipOptions
    from instdrive_core.training.run import RunRequest
    from instdrive_core.training.run import run_training as train
    from instdrive_core.training.settings.config import build_train_config

    config = build_train_config()
    extra = config.init.near_points + config.init.far_points
    config = replace(
        config,
        init=replace(config.init, lidar_points=max(1, options.gaussians - extra)),
        geometry=replace(config.geometry, iterations=10_000_000, coarse_iterations=0),
        densify=replace(config.densify, max_gaussians=0),
        report_every=20,
        checkpoint_every=2_000,
    )
    gauge, steps = Gauge(options.minutes), 0

    def listen(event: object) -> None:
        nonlocal steps
        steps = getattr(event, "iteration", steps)
        gauge.read()
        if gauge.over:
            raise Finished

    with tempfile.TemporaryDirectory() as folder, suppress(Finished):
        train(RunRequest(options.clip, Path(folder) / "run", ClipOptions(), config), listen, lambda _: None)
    return {"what": "training", "steps": steps, **gauge.result()}


Command = Annotated[Editing, tyro.conf.subcommand("editing")] | Annotated[Training, tyro.conf.subcommand("training")]


def main(options: Command) -> dict[str, object]:
    """Everything the JSON line says."""
    return run_editing(options) if isinstance(options, Editing) else run_training(options)


if __name__ == "__main__":
    try:
        print(json.dumps(main(tyro.cli(Command))))
    except InstDriveError as error:
        sys.exit(str(error))
