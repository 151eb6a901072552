"""`instdrive eval`: measure a trained run."""

from __future__ import annotations

from pathlib import Path

import tyro


def evaluate(run: tyro.conf.Positional[Path], json: Path | None = None) -> None:
    """Measure a trained run against held-out photos and labels.

    Args:
        run: Folder of the run that `train` wrote.
        json: File to write every figure into.
    """
    from rich.console import Console
    from rich.progress import Progress

    from instdrive_core.evaluation.protocol import evaluation_of_run
    from instdrive_core.evaluation.report import instance_table, summary_table, write_figures

    console = Console()
    with Progress(console=console, transient=True) as bar:
        tasks = {}

        def show(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = bar.add_task(stage, total=total)
            bar.update(tasks[stage], completed=done)

        evaluation = evaluation_of_run(run, show)
    console.print(instance_table(evaluation))
    console.print(summary_table(evaluation))
    if json is not None:
        write_figures(json, evaluation.figures)
        console.print(f"figures written to {json}")
