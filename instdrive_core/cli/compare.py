"""`instdrive compare`: measured runs side by side."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

if TYPE_CHECKING:
    from rich.table import Table

    from instdrive_core.evaluation.comparison import MeasuredRun

BEST = "★"


def compare(
    runs: tyro.conf.Positional[tuple[Path, ...]],
    html: Path | None = None,
    json: Path | None = None,
    fresh: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
) -> None:
    """Put measured runs side by side.

    Args:
        runs: Folders of runs, or files that `eval --json` wrote. A folder's eval.json is used where it is newer than
            the scene; else the run is evaluated first.
        html: File to write a page into, with the same held-out views of each run and its training curves.
        json: File to write the table into, as it reads: names of the runs, rows of cells, notes.
        fresh: Evaluate every folder again.
    """
    from rich.console import Console

    from instdrive_core.cli.eval_progress import show_eval_progress
    from instdrive_core.errors import OptionError
    from instdrive_core.evaluation.comparison import find_differences, measure_runs
    from instdrive_core.evaluation.page.compare import write_comparison

    if not runs:
        raise OptionError("no run to compare. Give one or more folders that `train` wrote.")
    console = Console()
    with show_eval_progress(console) as show:
        measured = measure_runs(runs, fresh, show)
    console.print(build_comparison_table(measured))
    for text in find_differences(measured):
        console.print(f"Note: {text}", markup=False, highlight=False, soft_wrap=True)
    if json is not None:
        _write_table(json, measured)
    if html is not None:
        write_comparison(html, measured)
        console.print(f"comparison written to {html}", markup=False, highlight=False, soft_wrap=True)


def _write_table(path: Path, runs: Sequence[MeasuredRun]) -> None:
    from dataclasses import asdict
    from json import dumps

    from instdrive_core.evaluation.comparison import compare_runs, find_differences
    from instdrive_core.files.atomic import write_bytes

    rows = [{"title": figure.title, "cells": [asdict(cell) for cell in cells]} for figure, cells in compare_runs(runs)]
    table = {"names": [run.name for run in runs], "rows": rows, "notes": find_differences(runs)}
    write_bytes(path, (dumps(table, indent=1) + "\n").encode())


def build_comparison_table(runs: Sequence[MeasuredRun]) -> Table:
    """A row per figure, a column per run; the best value has a star, differences are to the first run."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    from instdrive_core.evaluation.comparison import compare_runs

    title = f"{BEST} best value; differences to the first run" if len(runs) > 1 else None
    table = Table(title=title, box=box.SIMPLE_HEAD, title_justify="left", pad_edge=False)
    table.add_column("figure")
    for run in runs:
        table.add_column(Text(run.name), justify="right")
    for figure, cells in compare_runs(runs):
        texts = []
        for cell in cells:
            text = Text(f"{cell.text} {BEST if cell.best else ' '}" if len(runs) > 1 else cell.text)
            text.stylize("bold green" if cell.best else "")
            texts.append(text.append(f" {cell.delta}", style="dim") if cell.delta else text)
        table.add_row(figure.title, *texts)
    return table
