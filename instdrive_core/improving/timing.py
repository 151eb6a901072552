"""What a step of training on takes on this machine, measured on the scene itself."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import numpy as np

from instdrive_core.improving.base import BaseRun
from instdrive_core.improving.settings import build_improving_config
from instdrive_core.improving.start import build_improving_trainer
from instdrive_core.training.backends.device import choose_backend
from instdrive_core.training.settings.config import Device
from instdrive_core.training.views.view_store import open_view_store
from instdrive_core.training.warm_up import compile_kernels

_SETTLING_STEPS, _MOST_TIMED, _TIMED_SECONDS = 2, 12, 10.0


def measure_improving_step(base: BaseRun, device: Device = "auto", on_note: Callable[[str], None] = print) -> float:
    """Measure the seconds of a step, beginning with the base's splats; takes some 15 seconds."""
    config = build_improving_config(base.clip, len(base.scene), _MOST_TIMED)
    compile_kernels(on_note)
    with open_view_store(base.clip, None) as store:
        nothing = np.zeros(len(base.scene), bool)
        trainer = build_improving_trainer(config, base.scene, store, nothing, choose_backend(device))
        times: list[float] = []
        while len(times) < _SETTLING_STEPS + 1 or (len(times) < _MOST_TIMED and sum(times) < _TIMED_SECONDS):
            began = time.perf_counter()
            trainer.rgb_step()
            trainer.iteration += 1
            times.append(time.perf_counter() - began)
    return statistics.median(times[_SETTLING_STEPS:])
