"""``python -m benchmarks.devkits``: nuScenes' own program opens what is written in its layout. One JSON line.

nuscenes-devkit is installed into an environment of its own, as it asks for older packages than this program. There it
loads all tables (`tables`, its reverse index), checks that all files are there, and for each sample reads photos,
points and boxes. `boxes` are compared with the manifest of the recording: the largest differences of places and sizes
are `box_m`. `points_in_boxes` is the largest difference between the points that its own geometry counts in a box and
the written number; `projected` is the share of photos into which it projects points. `problems` is empty where its
assertions hold.
"""

from __future__ import annotations

import json
import subprocess
import venv
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import tyro

from instdrive_core.cli.recording.simulate import simulate_drive
from instdrive_core.cli.train import train
from instdrive_core.datasets.synthetic.config import StreetConfig
from instdrive_core.datasets.synthetic.write import write_street

_NEEDED = "numpy pyquaternion matplotlib scikit-learn scipy shapely tqdm cachetools opencv-python-headless pillow"
"""What its loader imports; all that it declares is a notebook server more."""
_CHILD = Path(__file__).with_name("devkit_child.py")


@dataclass(frozen=True)
class Options:
    """What is recorded, and where the environment is."""

    run: Path | None = None
    """A run; default: a small synthetic street is trained for a few steps."""
    environment: Path | None = None
    """Folder of an environment that is made, or used where it is there; default: one that is removed again."""


def install_devkit(environment: Path) -> Path:
    """Install nuscenes-devkit into an environment; returns its Python."""
    python = environment / "bin" / "python"
    if not python.is_file():
        venv.create(environment, with_pip=True)
        install = [str(python), "-m", "pip", "install", "--quiet"]
        subprocess.run([*install, *_NEEDED.split()], check=True)
        subprocess.run([*install, "--no-deps", "nuscenes-devkit"], check=True)
    return python


def main(options: Options) -> None:
    """Record, install, open, print."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        run = options.run
        if run is None:
            run = folder / "run"
            write_street(folder / "clip", StreetConfig(steps=6, width=160, height=90))
            train(folder / "clip", out=run, preset="demo", iterations=60)
        simulate_drive(run, out=folder / "out", width=160, last="4", layout=("nuscenes",))
        python = install_devkit(options.environment or folder / "environment")
        command = [
            str(python),
            str(_CHILD),
            str(folder / "out" / "layouts" / "nuscenes" / "drive"),
            str(folder / "out"),
        ]
        found = subprocess.run(command, capture_output=True, text=True, check=True)
        print(json.dumps(json.loads(found.stdout.splitlines()[-1])))


if __name__ == "__main__":
    main(tyro.cli(Options))
