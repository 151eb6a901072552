"""`instdrive eval`: measure a trained run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

REPORT = "report.html"


def evaluate(
    run: tyro.conf.Positional[Path],
    json: Path | None = None,
    html: Path | None = None,
    no_html: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
) -> None:
    """Measure a trained run against held-out photos and labels.

    A clip that has no labels, such as one of photos alone, is measured against its photos only.

    Args:
        run: Folder of the run that `train` wrote.
        json: File to write every figure into.
        html: File to write the report with pictures into; default: RUN/report.html.
        no_html: Write no report.
    """
    from rich.console import Console

    from instdrive_core.cli.eval_progress import show_eval_progress
    from instdrive_core.evaluation.page.report import write_report
    from instdrive_core.evaluation.protocol import evaluate_run
    from instdrive_core.evaluation.tables import (
        IMAGES_ONLY,
        build_map_table,
        build_point_table,
        build_summary_table,
        describe_split,
        write_figures,
    )

    console = Console()
    with show_eval_progress(console) as show:
        evaluation = evaluate_run(run, show)
    if evaluation.has_truth:
        console.print(build_map_table(evaluation))
    else:
        clip = evaluation.figures["clip"]
        console.print(f"{clip}: {IMAGES_ONLY}", markup=False, highlight=False, soft_wrap=True)
        console.print(describe_split(evaluation), markup=False, highlight=False, soft_wrap=True)
    points = build_point_table(evaluation)
    if points is not None:
        console.print(points)
    console.print(build_summary_table(evaluation))
    if json is not None:
        write_figures(json, evaluation.figures)
        console.print(f"figures written to {json}", markup=False, highlight=False, soft_wrap=True)
    if not no_html:
        page = html or run / REPORT
        write_report(page, run, evaluation)
        console.print(f"report with pictures written to {page}", markup=False, highlight=False, soft_wrap=True)
