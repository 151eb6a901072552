"""Curves of held-out PSNR over seconds, from what `benchmarks.time_to_quality` printed.

`python -m benchmarks.plot_quality docs/measurements/time_to_quality.jsonl` draws one curve a line; a line is what that
benchmark printed, with the key `label` added.
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import tyro
from matplotlib import pyplot as plt
from tyro.conf import Positional

from instdrive_core.errors import DataError, InstDriveError

mpl.use("Agg")


@dataclass(frozen=True)
class Options:
    """Draw the runs of a file."""

    runs: Positional[Path]
    out: Path = Path("docs/images/time_to_quality.png")
    target: float = 26.0
    """dB at which a line is drawn."""


def main(options: Options) -> None:
    """Draw and write the picture. Raises DataError where a line is no result."""
    figure, axes = plt.subplots(figsize=(7.2, 4.0), dpi=150, layout="constrained")
    for number, line in enumerate(options.runs.read_text(encoding="utf-8").splitlines(), 1):
        try:
            run = json.loads(line)
            steps = run["curve"]
            axes.plot([step[1] for step in steps], [step[2] for step in steps], marker="o", ms=3, label=run["label"])
        except (json.JSONDecodeError, KeyError, TypeError) as error:
            problem = f"line {number} is no labelled result of benchmarks.time_to_quality ({error!r})"
            raise DataError(options.runs, problem, "Add what the benchmark printed, with the key `label`") from error
    axes.axhline(options.target, color="0.7", lw=1, ls="--", zorder=0)
    axes.set_xlabel("seconds since the program started reading the clip, 2 threads")
    axes.set_ylabel("PSNR of held-out photos, dB")
    axes.grid(alpha=0.25)
    axes.legend(frameon=False, loc="lower right")
    options.out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(options.out)


if __name__ == "__main__":
    try:
        main(tyro.cli(Options))
    except InstDriveError as error:
        sys.exit(str(error))
