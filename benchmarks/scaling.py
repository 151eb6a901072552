"""How the cost of a training step grows with Gaussians and with pixels.

`python -m benchmarks.scaling` prints one JSON line: median milliseconds of a whole step, as in `benchmarks.train_step`,
for 20k … 2M Gaussians at 480×270 and for 100k at four image sizes, with exponents of cost ~ countᵉ between neighbours.
"""

from __future__ import annotations

import json
import statistics
import sys
from dataclasses import dataclass
from itertools import pairwise
from math import log

import numba
import torch
import tyro

from benchmarks.train_step import Step, build_workload_model
from benchmarks.workload import generate_workload
from instdrive_core.errors import InstDriveError

COUNTS = (20_000, 100_000, 500_000, 2_000_000)
SIZES = ((240, 135), (480, 270), (960, 540), (1920, 1080))


@dataclass(frozen=True)
class Options:
    """Time training steps on streets of growing size."""

    runs: int = 7
    """Timed steps of each."""


def step_ms(count: int, width: int, height: int, runs: int) -> float:
    """Median milliseconds of one step, state `init`."""
    workload = generate_workload(count, width, height, "init")
    step = Step(build_workload_model(workload), workload.cameras[0])
    totals = [sum(step.run().values()) for _ in range(runs + 2)]
    return statistics.median(totals[2:])


def compute_exponents(amounts: list[float], costs: list[float]) -> list[float]:
    """Exponents e of cost ~ amountᵉ between neighbours."""
    return [
        round(log(second / first) / log(more / less), 2)
        for (less, more), (first, second) in zip(pairwise(amounts), pairwise(costs), strict=True)
    ]


def main(options: Options) -> dict[str, object]:
    """Everything the JSON line says."""
    torch.set_num_threads(1)  # as training does
    by_count = [round(step_ms(count, 480, 270, options.runs), 1) for count in COUNTS]
    by_size = [round(step_ms(100_000, width, height, options.runs), 1) for width, height in SIZES]
    return {
        "threads": numba.get_num_threads(),
        "gaussians": COUNTS,
        "ms_480x270": by_count,
        "exponents_gaussians": compute_exponents([float(count) for count in COUNTS], by_count),
        "sizes": SIZES,
        "ms_100k": by_size,
        "exponents_pixels": compute_exponents([float(width * height) for width, height in SIZES], by_size),
    }


if __name__ == "__main__":
    try:
        print(json.dumps(main(tyro.cli(Options))))
    except InstDriveError as error:
        sys.exit(str(error))
