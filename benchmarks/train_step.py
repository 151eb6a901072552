"""One whole training step on the shared workload: the trainer's own operations, RGB and 8 features.

`python -m benchmarks.train_step --workload W2 --state init` prints one JSON line. A step is: rows in view, harmonics of
degree 3, projection, binning, blending of 11 channels, L1 + SSIM, all of it backward, and Adam on the visible Gaussians
(59 numbers each, and 8 features). Times are medians after a warm-up. `share_forward` is the forward pass's share of the
Gaussian-pixel rate that this machine reaches in a loop on data at hand, probed in the same run.
"""

from __future__ import annotations

import json
import resource
import statistics
import sys
import time
from dataclasses import dataclass
from typing import Literal

import numba
import numpy as np
import torch
import tyro

from benchmarks.probe import count_evaluations, measure_pixel_rate
from benchmarks.workload import Workload, load_workload
from instdrive_core.errors import InstDriveError
from instdrive_core.maths.spherical_harmonics import dc_from_color
from instdrive_core.rasterize.render import render
from instdrive_core.scene.camera import Camera
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.training.backends.cpu_backend import CpuBackend
from instdrive_core.training.gaussians.model import SceneModel, build_model
from instdrive_core.training.gaussians.optimizers import Optimizers
from instdrive_core.training.gaussians.view_rendering import render_view
from instdrive_core.training.settings.config import build_train_config

_FEATURES, _SH_REST = 8, 15
_WARM_UP = 3


@dataclass(frozen=True)
class Options:
    """Time one whole training step."""

    workload: Literal["W1", "W2", "W3"] = "W2"
    """W1: 20k Gaussians at 480×270, W2: 100k at 480×270, W3: 100k at 960×540."""
    state: Literal["init", "trained"] = "init"
    """Gaussians as training starts with them, or as it leaves them."""
    runs: int = 15
    """Timed steps."""


def build_workload_model(workload: Workload) -> SceneModel:
    """The workload as a static trainable scene."""
    count = len(workload.means)
    logits = np.log(workload.opacities) - np.log1p(-workload.opacities)
    gaussians = Gaussians(
        means=workload.means,
        quats=workload.quats,
        log_scales=workload.log_scales,
        opacity_logits=logits,
        sh_dc=dc_from_color(workload.channels[:, :3]),
        sh_rest=np.zeros((count, _SH_REST, 3), np.float32),
        features=workload.channels[:, 3 : 3 + _FEATURES],
    )
    sky = np.full((6, 8, 8, 3), 0.5, np.float32)
    return build_model(gaussians, np.zeros(count, np.uint16), (), sky, (0.0,))


class Step:
    """The operations of one step, timed one after the other."""

    def __init__(self, model: SceneModel, camera: Camera) -> None:
        self.model, self.camera, self.backend = model, camera, CpuBackend()
        config = build_train_config()
        self.optimizers = Optimizers(model, config)
        self.optimizers.geometry.rates = dict.fromkeys(
            self.optimizers.geometry.rates, 0.0
        )  # the workload stays as it is
        features = self.optimizers.features
        assert features is not None, "the workload's Gaussians carry features"
        features.rates = {"features": 0.0}
        self.features = features
        rng = np.random.default_rng(0)
        self.photo = rng.integers(0, 256, (camera.height, camera.width, 3)).astype(np.uint8)
        pull = rng.normal(0, 1e-3, (camera.height, camera.width, _FEATURES)).astype(np.float32)
        self.pull = torch.from_numpy(pull)

    def run(self) -> dict[str, float]:
        """Milliseconds of each phase."""
        marks = [time.perf_counter()]
        drawn = render_view(self.model, self.backend, self.camera, 0.0, with_features=True)
        marks.append(time.perf_counter())
        loss, _ = self.backend.photometric_loss(drawn.color, self.photo, None, 0.2)
        assert drawn.features is not None
        marks.append(time.perf_counter())
        torch.autograd.backward([loss, drawn.features], [None, self.pull])
        marks.append(time.perf_counter())
        gradients = drawn.gradients()
        features = {"features": gradients.pop("features")}
        self.optimizers.geometry.step(drawn.rows, gradients, drawn.seen.visible)
        self.features.step(drawn.rows, features, drawn.seen.visible)
        marks.append(time.perf_counter())
        names = ("forward", "loss", "backward", "optimizer")
        return {name: 1e3 * (end - start) for name, start, end in zip(names, marks, marks[1:], strict=False)}


def forward_seconds(workload: Workload, runs: int) -> float:
    """Median seconds of projection, binning and blending of 11 channels."""
    seconds = []
    for _ in range(runs + _WARM_UP):
        start = time.perf_counter()
        render(
            workload.means,
            workload.quats,
            workload.log_scales,
            workload.opacities,
            workload.channels,
            workload.cameras[0],
        )
        seconds.append(time.perf_counter() - start)
    return statistics.median(seconds[_WARM_UP:])


def measure(options: Options) -> dict[str, object]:
    """Everything the JSON line says."""
    torch.set_num_threads(1)  # as training does
    workload = load_workload(options.workload, options.state)
    step = Step(build_workload_model(workload), workload.cameras[0])
    phases = [step.run() for _ in range(options.runs + _WARM_UP)][_WARM_UP:]
    medians = {name: statistics.median(phase[name] for phase in phases) for name in phases[0]}
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    rate = count_evaluations(workload, workload.cameras[0]) / forward_seconds(workload, options.runs)
    return {
        "workload": options.workload,
        "state": options.state,
        "threads": numba.get_num_threads(),
        "phase_ms": {name: round(value, 2) for name, value in medians.items()},
        "total_ms": round(statistics.median(sum(phase.values()) for phase in phases), 2),
        "peak_rss_mb": round(peak),
        "share_forward": round(rate / measure_pixel_rate(), 3),
    }


if __name__ == "__main__":
    try:
        print(json.dumps(measure(tyro.cli(Options))))
    except InstDriveError as error:
        sys.exit(str(error))
