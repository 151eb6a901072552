"""Evaluation on the terminal: one bar per stage, gone when it is done."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import Progress, TaskID

from instdrive_core.evaluation import protocol


@contextmanager
def show_eval_progress(console: Console) -> Iterator[protocol.Progress]:
    """Yields what evaluation calls with the stage's name, steps done and steps in all."""
    with Progress(console=console, transient=True) as bar:
        tasks: dict[str, TaskID] = {}

        def show(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = bar.add_task(stage, total=total)
            bar.update(tasks[stage], completed=done)

        yield show
