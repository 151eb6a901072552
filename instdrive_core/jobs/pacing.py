"""How many training steps fit into some minutes on this machine, from a few steps that are timed on the clip itself."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from instdrive_core.datasets.clip import Clip
from instdrive_core.training.backends.device import choose_backend
from instdrive_core.training.build_trainer import build_trainer_from_clip
from instdrive_core.training.settings.clip_size import USUAL_PHOTOS, AskedSizes, fit_to_clip
from instdrive_core.training.settings.config import Device, Preset, TrainConfig, build_train_config, keep_cameras
from instdrive_core.training.views.view_store import open_view_store
from instdrive_core.training.warm_up import compile_kernels

MOST_STEPS, LEAST_STEPS = 30_000, 200
TRAINED_SHARE = 0.75
"""Share of the time left that trains colour and shape; instances, writing and the evaluation have the rest."""
LEAST_SHARE = 0.3
"""Share of all minutes that training gets even where the stages before took longer than thought."""
GROWTH = 1.25
"""A step's mean time over a whole training, as a multiple of that of its first steps: Gaussians grow in number."""
_SETTLING_STEPS, _MOST_TIMED, _TIMED_SECONDS = 2, 12, 10.0
_TRIED_PHOTOS = 12


@dataclass(frozen=True)
class Pace:
    """Steps that a job trains, and what they are expected to take."""

    iterations: int
    step_seconds: float
    """Expected mean of all steps."""

    @property
    def seconds(self) -> float:
        """Expected time of all steps."""
        return self.iterations * self.step_seconds


def measure_step_seconds(clip: Clip, device: Device = "auto", on_note: Callable[[str], None] = print) -> float:
    """Measure what a training step of a clip takes on this machine, with the Gaussians that it starts from.

    A dozen photos spread over the clip stand for all of them. Takes some 15 seconds.
    """
    frames = clip.training_frames
    chosen = np.unique(np.linspace(0, len(frames) - 1, min(len(frames), _TRIED_PHOTOS)).round().astype(int))
    steps = {frames[number].view.index for number in chosen}
    part = replace(
        clip,
        frames=tuple(frames[number] for number in chosen),
        sweeps=tuple(sweep for sweep in clip.sweeps if sweep.index in steps),
    )
    config = build_train_config("instdrive", "quick")
    config = config if part.training_sweeps else keep_cameras(config)
    compile_kernels(on_note)
    with open_view_store(part, None) as store:
        trainer = build_trainer_from_clip(config, part, store, choose_backend(device))
        trainer.iteration = config.geometry.coarse_iterations
        times: list[float] = []
        while len(times) < _SETTLING_STEPS + 1 or (len(times) < _MOST_TIMED and sum(times) < _TIMED_SECONDS):
            began = time.perf_counter()
            trainer.rgb_step()
            trainer.iteration += 1
            times.append(time.perf_counter() - began)
    return statistics.median(times[_SETTLING_STEPS:])


def choose_pace(step_seconds: float, minutes: float, spent: float) -> Pace:
    """Choose how many steps fit.

    Args:
        step_seconds: measured time of a step.
        minutes: of the whole job.
        spent: seconds that the job has taken so far.
    """
    whole = 60 * minutes
    room = max(TRAINED_SHARE * (whole - spent), LEAST_SHARE * whole)
    mean = GROWTH * step_seconds
    return Pace(int(np.clip(round(room / mean), LEAST_STEPS, MOST_STEPS)), mean)


def build_paced_config(clip: Clip, iterations: int) -> TrainConfig:
    """Build the configuration of a training of so many steps; short ones grow fewer Gaussians."""
    demo = build_train_config("instdrive", "demo")
    preset: Preset = "demo" if iterations <= demo.geometry.iterations else "quick"
    return fit_to_clip(build_train_config("instdrive", preset), clip, AskedSizes(iterations))


def describe_pace(pace: Pace, photos: int) -> str:
    """Say what a training will be, beside the usual one."""
    each, usual = pace.iterations / photos, build_train_config().geometry.iterations / USUAL_PHOTOS
    if each >= 2 * usual:
        words = "more than a usual training: fine detail"
    elif each >= 0.8 * usual:
        words = "as a usual training"
    elif each >= 0.35 * usual:
        words = "less than a usual training: good to look at and to edit, soft in detail"
    else:
        words = "far less than a usual training: a first look"
    return (
        f"{pace.iterations:,} steps of {1000 * pace.step_seconds:.0f} ms: "
        f"each of {photos:,} photos is seen {each:.0f} times, {words}"
    )
