"""``python -m benchmarks.sweeps --run RUN``: LiDAR sweeps cast into scenes against measured ones. One JSON line.

Held-out sweeps are cast along the directions in which they met something: `lidar_median_m` is the median difference of
the ranges where something returned, `unlearned_median_m` the same without what training sweeps say of splats,
`lidar_recall` the share of rays where something did, `seconds_sweep` the median time. `count_error` is how far counts
of points are off, by patch of directions, if the sensor's whole grid is cast, `count_error_ray_drop` with learned ray
drop. `real_…` are the same of a second run, of a real drive. Without runs a synthetic street is trained.
"""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import tyro
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.cli.train import train
from instdrive_core.datasets.clip import Sweep, is_held_out
from instdrive_core.datasets.synthetic.config import StreetConfig
from instdrive_core.datasets.synthetic.write import write_street
from instdrive_core.errors import OptionError
from instdrive_core.formats.registry import open_scene
from instdrive_core.recording.run_clip import open_run_clip
from instdrive_core.sweeps.cast import RayCaster
from instdrive_core.sweeps.drops import find_patches, learn_drop
from instdrive_core.sweeps.offsets import learn_offsets
from instdrive_core.sweeps.pattern import trace_pattern
from instdrive_core.sweeps.place import find_sensor_place
from instdrive_core.sweeps.rig import Rig, build_rig


@dataclass(frozen=True)
class Options:
    """Which trained scenes are measured."""

    run: Path | None = None
    """A run on a synthetic street; default: one is written and trained with the preset `demo`."""
    real: Path | None = None
    """A run on a real drive."""


def measure_sweeps(run: Path) -> dict[str, Any]:
    """Cast the held-out sweeps of a run's clip. Raises OptionError where there are none."""
    scene = open_scene(run)
    clip, problem = open_run_clip(run, scene)
    sweeps = [sweep for sweep in clip.sweeps if is_held_out(sweep.index)] if clip is not None else []
    if clip is None or not sweeps:
        raise OptionError(f"{run}: {problem or 'its clip has no held-out sweeps'}")
    rig, bare = build_rig([frame.view for frame in clip.frames]), RayCaster(scene)
    place = find_sensor_place(rig, clip.training_sweeps)
    started = time.perf_counter()
    caster = RayCaster(scene, offsets=learn_offsets(bare, rig, clip.training_sweeps, place))
    learning = time.perf_counter() - started
    misses, unlearned, shares, seconds, rays = [], [], [], [], []
    for sweep in sweeps:
        pattern = trace_pattern(rig, sweep.time, sweep.load(), place)
        aimed = pattern.aim(rig, sweep.time)
        started = time.perf_counter()
        ranges = caster.cast(aimed).ranges
        seconds.append(time.perf_counter() - started)
        met = np.isfinite(ranges)
        measured = np.zeros(len(ranges)) if pattern.ranges is None else pattern.ranges
        misses.append(np.abs(ranges - measured)[met])
        unlearned.append(np.abs(bare.cast(aimed).ranges - measured)[met])
        shares.append(met.mean())
        rays.append(len(ranges))
    return {
        "lidar_median_m": round(float(np.median(np.concatenate(misses))), 4),
        "lidar_recall": round(float(np.mean(shares)), 4),
        **_measure_drop(bare, rig, clip.training_sweeps, sweeps, place),
        "unlearned_median_m": round(float(np.median(np.concatenate(unlearned))), 4),
        "seconds_learning": round(learning, 1),
        "seconds_sweep": round(float(np.median(seconds)), 3),
        "rays": int(np.median(rays)),
        "gaussians": len(scene),
        "sensor_place_m": np.round(place, 2).tolist(),
    }


def _measure_drop(
    caster: RayCaster, rig: Rig, training: Sequence[Sweep], held_out: Sequence[Sweep], place: Float64[ndarray, "3"]
) -> dict[str, float]:
    """How far counts of points by patch of directions are from held-out sweeps' ones, without and with lost rays."""
    drop = learn_drop(caster, rig, training, place)
    aimed = find_patches(drop.grid.directions)
    errors = []
    for sweep in held_out:
        found = find_patches(trace_pattern(rig, sweep.time, sweep.load(), place).directions)
        returns = caster.cast(drop.grid.aim(rig, sweep.time))
        size = int(max(found.max(), aimed.max())) + 1
        measured = np.bincount(found, minlength=size)
        counted = [
            np.bincount(aimed[kept], minlength=size)
            for kept in (np.isfinite(returns.ranges), drop.draw_kept(returns, sweep.index))
        ]
        errors.append([np.abs(count - measured).sum() / len(found) for count in counted])
    without, drawn = np.mean(errors, axis=0).tolist()
    return {"count_error": round(without, 4), "count_error_ray_drop": round(drawn, 4)}


def main(options: Options) -> None:
    """Measure and print."""
    with TemporaryDirectory() as name:
        run = options.run
        if run is None:
            clip, run = Path(name) / "clip", Path(name) / "run"
            write_street(clip, StreetConfig())
            train(clip, out=run, preset="demo")
        found = measure_sweeps(run)
        real = measure_sweeps(options.real) if options.real is not None else {}
        print(json.dumps(found | {f"real_{key}": value for key, value in real.items()}))


if __name__ == "__main__":
    main(tyro.cli(Options))
