"""Forward and backward time of the CPU rasterizer on the shared workload, and the share of what the machine can do.

`python -m benchmarks.rasterize --workload W2 --state init` prints one JSON line; times include projection, binning
and the projection's backward pass, and are the median of several runs after a warm-up.
"""

from __future__ import annotations

import json
import statistics
import sys
import time
from dataclasses import dataclass
from typing import Literal

import numba
import numpy as np
import tyro

from benchmarks.probe import count_evaluations, measure_pixel_rate
from benchmarks.workload import Workload, load_workload
from instdrive_core.errors import InstDriveError, OptionError
from instdrive_core.rasterize.render import render, render_backward

_GEOMETRY_CHANNELS = 3


@dataclass(frozen=True)
class Options:
    """Time the CPU rasterizer."""

    workload: Literal["W1", "W2", "W3"] = "W2"
    """W1: 20k Gaussians at 480×270, W2: 100k at 480×270, W3: 100k at 960×540."""
    state: Literal["init", "trained"] = "init"
    """Gaussians as training starts with them, or as it leaves them."""
    channels: int = 11
    """RGB and up to 8 features: 0 … 11."""
    runs: int = 15
    """Timed runs."""


def measure(workload: Workload, channels: int, runs: int) -> tuple[float, float]:
    """Median milliseconds of the forward and the backward pass."""
    if not 0 <= channels <= workload.channels.shape[1]:
        raise OptionError(f"--channels is {channels}; the workload has {workload.channels.shape[1]}, choose 0 … that")
    camera, values = workload.cameras[0], np.ascontiguousarray(workload.channels[:, :channels])
    rng = np.random.default_rng(0)
    shape = (camera.height, camera.width)
    grad_image, grad_depth, grad_alpha = (
        rng.normal(size=size).astype(np.float32) for size in ((*shape, channels), shape, shape)
    )
    forward, backward = [], []
    for _ in range(runs + 3):
        start = time.perf_counter()
        raster = render(workload.means, workload.quats, workload.log_scales, workload.opacities, values, camera)
        middle = time.perf_counter()
        render_backward(raster.context, grad_image, grad_depth, grad_alpha, min(channels, _GEOMETRY_CHANNELS))
        end = time.perf_counter()
        forward.append(1e3 * (middle - start))
        backward.append(1e3 * (end - middle))
    return statistics.median(forward[3:]), statistics.median(backward[3:])


def main(options: Options) -> None:
    """Measure and print one JSON line."""
    workload = load_workload(options.workload, options.state)
    forward, backward = measure(workload, options.channels, options.runs)
    rate, needed = measure_pixel_rate(), count_evaluations(workload, workload.cameras[0])
    figures = {
        "workload": options.workload,
        "state": options.state,
        "channels": options.channels,
        "threads": numba.get_num_threads(),
        "forward_ms": round(forward, 2),
        "backward_ms": round(backward, 2),
        "total_ms": round(forward + backward, 2),
        "evaluations": needed,
        "peak_rate": round(rate),
        "share_forward": round(needed / (1e-3 * forward) / rate, 3),
    }
    print(json.dumps(figures))


if __name__ == "__main__":
    try:
        main(tyro.cli(Options))
    except InstDriveError as error:
        sys.exit(str(error))
