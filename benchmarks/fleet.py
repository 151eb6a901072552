"""A fleet with a worker that is killed: `python -m benchmarks.fleet` prints one JSON line.

Synthetic clips are trained by `instdrive fleet` on this machine. As soon as one has trained past its first checkpoint,
its worker gets SIGKILL. All lines that appear in the logs of the trainings are kept: a step that was trained again has
another line. `trained_twice` counts clips that trained more again than lay between two checkpoints, or were finished
twice.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import tyro

from instdrive_core.datasets.synthetic.config import StreetConfig
from instdrive_core.datasets.synthetic.write import write_street
from instdrive_core.errors import InstDriveError
from instdrive_core.files.json_fields import read_json
from instdrive_core.training.run import LOG

_LOOK_SECONDS = 0.02


class FleetFailedError(InstDriveError):
    """The fleet did not end as it should."""


@dataclass(frozen=True)
class Options:
    """Train clips and kill a worker."""

    clips: int = 4
    steps: int = 5
    """Time steps of each clip."""
    width: int = 64
    """Pixels across the photos."""
    iterations: int = 120
    checkpoint_every: int = 20
    cpus_per_clip: float = 1.0
    evaluate: bool = False
    patience: float = 900.0
    """Seconds after which the fleet counts as hanging."""


@dataclass
class TrainingWatch:
    """Every line that a training's log has held."""

    log: Path
    lines: Counter[tuple[str, int]] = field(default_factory=Counter)
    """How often each reported step was trained, by stage and number."""
    _seen: set[str] = field(default_factory=set)

    def look(self) -> None:
        """Read the log as it is now."""
        text = self.log.read_text(encoding="utf-8") if self.log.is_file() else ""
        for line in text.splitlines(keepends=True):
            if line.endswith("\n") and line not in self._seen:
                self._seen.add(line)
                step = json.loads(line)
                self.lines[step["stage"], step["iteration"]] += 1

    @property
    def last(self) -> int:
        """The furthest step of colour and shape."""
        return max((number for stage, number in self.lines if stage == "rgb"), default=0)

    def count_repeated(self, report_every: int) -> int:
        """Count steps that were trained again, to the whole of reported ones."""
        return report_every * sum(count - 1 for count in self.lines.values())


def main(options: Options) -> dict[str, Any]:
    """Everything the JSON line says."""
    with tempfile.TemporaryDirectory() as folder:
        return measure_fleet(options, Path(folder))


def measure_fleet(options: Options, folder: Path) -> dict[str, Any]:
    """Record the clips in a folder, train them and kill a worker. Raises FleetFailedError where none was killed."""
    names = [f"clip-{number}" for number in range(options.clips)]
    for number, name in enumerate(names):
        size = (options.width, options.width * 9 // 16)
        street = StreetConfig(number, options.steps, *size, lidar_azimuths=200)
        write_street(folder / name, street)
    runs, output = folder / "runs", folder / "output.txt"
    command = [sys.executable, "-m", "instdrive_app.main", "fleet", *(str(folder / name) for name in names)]
    command += ["-o", str(runs), "--iterations", str(options.iterations), "--cpus-per-clip", str(options.cpus_per_clip)]
    command += ["--checkpoint-every", str(options.checkpoint_every), *([] if options.evaluate else ["--no-eval"])]
    watches, killed, began = {name: TrainingWatch(runs / name / LOG) for name in names}, "", time.monotonic()
    with output.open("wb") as file:
        process = subprocess.Popen(command, stdout=file, stderr=subprocess.STDOUT)
        try:
            while process.poll() is None and time.monotonic() < began + options.patience:
                for name, watch in watches.items():
                    watch.look()
                    if not killed and options.checkpoint_every < watch.last < options.iterations:
                        os.kill(read_json(runs / name / "job" / "fleet_worker.json")["pid"], signal.SIGKILL)
                        killed = name
                time.sleep(_LOOK_SECONDS)
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
                process.wait(90)
    for watch in watches.values():
        watch.look()
    seconds = time.monotonic() - began
    if not killed:
        raise FleetFailedError(f"no worker was killed; the fleet said: {output.read_text(errors='replace')}")
    return _collect(options, runs, watches, killed, seconds)


def _collect(
    options: Options, runs: Path, watches: dict[str, TrainingWatch], killed: str, seconds: float
) -> dict[str, Any]:
    known = {clip["name"]: clip for clip in read_json(runs / "fleet.json")["clips"]}
    config = read_json(runs / killed / "config.json")["train"]
    last = ("rgb", options.iterations)
    repeated = {name: watch.count_repeated(config["report_every"]) for name, watch in watches.items()}
    return {
        "clips": options.clips,
        "done": sum(clip["status"] == "done" for clip in known.values()),
        "trained_twice": sum(
            repeated[name] > options.checkpoint_every or watch.lines[last] > 1 for name, watch in watches.items()
        ),
        "seconds": round(seconds, 1),
        "killed": killed,
        "killed_after_step": next((step for step in _list_repeats(watches[killed])), None),
        "steps_repeated": sum(repeated.values()),
        "reasons": [attempt["problem"] for attempt in known[killed]["attempts"]],
    }


def _list_repeats(watch: TrainingWatch) -> list[int]:
    return sorted((number for (_, number), count in watch.lines.items() if count > 1), reverse=True)


if __name__ == "__main__":
    print(json.dumps(main(tyro.cli(Options, description=__doc__))))
