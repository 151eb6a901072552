"""Peak memory of a whole training run: reading, both stages, checkpoints, writing the scene.

`python -m benchmarks.memory CLIP` trains half a million Gaussians at half of PandaSet's width for a few steps (every
photo once) and prints one JSON line. Memory does not grow with the number of steps, so few are enough.
"""

from __future__ import annotations

import json
import resource
import sys
import tempfile
from dataclasses import dataclass, field, replace
from pathlib import Path

import tyro
from tyro.conf import Positional

from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.errors import InstDriveError
from instdrive_core.training.run import FACTS, RunRequest, run_training
from instdrive_core.training.settings.config import build_train_config


@dataclass(frozen=True)
class Options:
    """Train briefly and report the peak."""

    clip: Positional[Path]
    masks: Path | None = None
    """Folder of masks; default: the clip's own, else made from annotations."""
    gaussians: int = 500_000
    """Gaussians to start with, about."""
    steps: int = 200
    """Steps of each stage."""
    options: ClipOptions = field(default_factory=lambda: ClipOptions(scale=0.5))


def main(options: Options) -> dict[str, object]:
    """Everything the JSON line says."""
    config = build_train_config()
    extra = config.init.near_points + config.init.far_points
    config = replace(
        config,
        init=replace(config.init, lidar_points=options.gaussians - extra),
        geometry=replace(config.geometry, iterations=options.steps, coarse_iterations=0),
        densify=replace(config.densify, max_gaussians=0),
        instances=replace(config.instances, iterations=options.steps),
        checkpoint_every=options.steps // 2,
    )
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        request = RunRequest(options.clip, out, options.options, config, options.masks)
        run_training(request, lambda event: None, lambda note: print(note, file=sys.stderr))
        facts = json.loads((out / FACTS).read_text())
    return {
        "gaussians": facts["n_gaussians"],
        "scale": options.options.scale,
        "instances": facts["n_instances"],
        "peak_rss_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024),
    }


if __name__ == "__main__":
    try:
        print(json.dumps(main(tyro.cli(Options))))
    except InstDriveError as error:
        sys.exit(str(error))
