"""How long it takes to make instances of codewords, and what their table and names take.

`python -m benchmarks.components [--run RUN]` prints one JSON line: seconds (the best of several runs, after the kernels
were compiled) of `split_components`, `build_instance_table` and `find_instance_classes` on a trained scene grown to a
million Gaussians in two ways. `longer`: copies of the drive, one behind the other. `denser`: copies in place, each
Gaussian moved by a draw from its own distribution, as splitting does. Names need a run's own clip: without `--run` the
sample scene is measured, and they are null.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numba
import numpy as np
import tyro

from benchmarks.workload import ROOT
from instdrive_core.datasets.clip import Clip
from instdrive_core.datasets.registry import load_clip
from instdrive_core.errors import InstDriveError
from instdrive_core.evaluation.run_facts import build_clip_options, read_run_facts
from instdrive_core.formats.folder.scenes import read_scene_folder
from instdrive_core.instances.components import split_components
from instdrive_core.instances.table import build_instance_table
from instdrive_core.maths.rotations import matrix_from_quaternion
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene
from instdrive_core.training.instances.naming import find_instance_classes

Growth = Literal["longer", "denser"]


@dataclass(frozen=True)
class Options:
    """Time the way from codewords to named instances."""

    run: Path | None = None
    """A finished run whose scene is grown; without one the sample scene is."""
    gaussians: int = 1_000_000
    """Gaussians of the grown scene."""
    runs: int = 3
    """Timed runs, of which the best counts."""


@dataclass(frozen=True)
class GrownScene:
    """A scene's Gaussians, several times over."""

    gaussians: Gaussians
    nodes: np.ndarray
    codewords: np.ndarray


def grow_scene(scene: Scene, count: int, growth: Growth) -> GrownScene:
    """A scene of `count` Gaussians; codewords are those of the Gaussians copied."""
    rows = np.arange(count) % len(scene)
    gaussians = scene.gaussians.select(rows)
    copies = np.arange(count) // len(scene)
    background = scene.nodes[rows] == 0
    rng = np.random.default_rng(0)
    if growth == "denser":
        axes = matrix_from_quaternion(gaussians.quats)
        draws = rng.normal(size=(count, 3)) * np.exp(gaussians.log_scales)
        gaussians.means += np.einsum("nij,nj->ni", axes, draws * (copies > 0)[:, None]).astype(np.float32)
    else:
        length = np.ptp(np.quantile(scene.gaussians.means[scene.nodes == 0], [0.01, 0.99], axis=0), axis=0)
        axis = int(np.argmax(length))
        gaussians.means[background, axis] += (copies * length[axis]).astype(np.float32)[background]
        gaussians.means += rng.normal(0, 1e-3, (count, 3)).astype(np.float32)
    return GrownScene(gaussians, scene.nodes[rows], scene.codewords[rows])


def seconds(work: Callable[[], Any], runs: int) -> float:
    """The best of several runs, rounded; the first of all compiles and does not count."""
    work()
    best = np.inf
    for _ in range(runs):
        start = time.perf_counter()
        work()
        best = min(best, time.perf_counter() - start)
    return round(best, 3)


def measure_components(scene: GrownScene, clip: Clip | None, labels: list[str], runs: int) -> dict[str, object]:
    """Seconds of each part on one scene, and how many instances came out."""
    gaussians, nodes, codewords = scene.gaussians, scene.nodes, scene.codewords
    scales, opacities = gaussians.scales, gaussians.opacities
    ids = split_components(gaussians.means, scales, nodes, codewords, opacities)
    named = None
    if clip is not None:
        named = seconds(lambda: find_instance_classes(clip, ids, gaussians.means, nodes, labels), runs)
    return {
        "gaussians": len(gaussians),
        "instances": int(ids.max()),
        "without_instance": round(float(np.mean(ids == 0)), 4),
        "split_components": seconds(
            lambda: split_components(gaussians.means, scales, nodes, codewords, opacities), runs
        ),
        "table_from_ids": seconds(lambda: build_instance_table(ids, gaussians.means, codewords, nodes), runs),
        "instance_classes": named,
    }


def main(options: Options) -> dict[str, object]:
    """Everything the JSON line says."""
    scene = read_scene_folder(options.run or ROOT / "assets" / "sample_scene")
    clip = None
    if options.run is not None:
        facts = read_run_facts(options.run)
        clip = load_clip(facts["clip"], build_clip_options(facts))
    labels = [actor.label for actor in scene.actors]
    growths: tuple[Growth, ...] = ("longer", "denser")
    figures = {
        growth: measure_components(grow_scene(scene, options.gaussians, growth), clip, labels, options.runs)
        for growth in growths
    }
    return {"threads": numba.get_num_threads(), "seconds": figures}


if __name__ == "__main__":
    try:
        print(json.dumps(main(tyro.cli(Options))))
    except InstDriveError as error:
        sys.exit(str(error))
