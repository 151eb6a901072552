"""Figures for readers: a JSON file for programs, tables for people."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich import box
from rich.table import Table

from instdrive_core.evaluation.protocol import Evaluation
from instdrive_core.formats.atomic import write_bytes


def write_figures(path: Path, figures: Mapping[str, Any]) -> None:
    """Write figures as one JSON object, atomically. Raises ValueError for a figure that is NaN or infinite."""
    write_bytes(path, (json.dumps(figures, indent=2, allow_nan=False) + "\n").encode())


def instance_table(evaluation: Evaluation) -> Table:
    """How well each predicted map agrees with the ground truth, in 80 columns.

    Oracle: true IDs on this geometry. Instance: what a click selects. Codeword: of the rendered feature. The last
    rows are trivial controls.
    """
    figures = evaluation.figures
    table = Table(
        title=f"Instance maps, {_split(evaluation)}", box=box.SIMPLE_HEAD, title_justify="left", pad_edge=False
    )
    table.add_column("predicted map", no_wrap=True)
    per_view, scene = ("view mIoU", "mAcc"), ("scene mIoU", "mAcc", "PQ", "Acc @.25", "Acc @.5", "ID sw.")
    for title in (*per_view, *scene):
        table.add_column(title.replace(" ", "\n"), justify="right", no_wrap=True)
    oracle = {"miou": figures["scene"]["oracle_miou"], "pq": figures["scene"]["oracle_pq"]}
    rows = {
        "oracle": {"per_view": {}, "scene": oracle},
        "instance": figures,
        "codeword": figures["codeword"],
        **evaluation.controls,
    }
    for name, scores in rows.items():
        per_view, scene = scores["per_view"], scores["scene"]
        values = [per_view.get("miou"), per_view.get("macc")]
        values += [scene.get(key) for key in ("miou", "macc", "pq", "acc25", "acc50", "id_switches")]
        table.add_row(name, *(_text(value) for value in values))
    return table


def summary_table(evaluation: Evaluation) -> Table:
    """Images, clicks, size and cost of a run."""
    figures = evaluation.figures
    click, scene = figures["click"], figures["scene"]
    table = Table(box=box.SIMPLE, pad_edge=False, show_header=False)
    table.add_column()
    table.add_column(justify="right")
    rows = {
        "PSNR (dB)": _text(figures["psnr"], 2),
        "PSNR in the boxes of moving objects (dB)": _text(figures["psnr_actors"], 2),
        "SSIM": _text(figures["ssim"]),
        "scene mIoU of things / stuff": f"{_text(scene['miou_things'])} / {_text(scene['miou_stuff'])}",
        "clicks that hit the object (IoU of the selection > 0.5)": _text(click["hit_rate"]),
        "mean IoU of selections": _text(click["iou"]),
        "collateral of deleting hits: other pixels changed": _text(click["collateral"], 4),
        "residue of deleting hits: weight left in the box": _text(click["residue"], 4),
        "Gaussians / instances": f"{figures['n_gaussians']:,} / {figures['n_instances']:,}",
        "training": f"{figures['train_seconds']:.0f} s, {figures['peak_rss_mb']:,.0f} MB, {figures['backend']}",
    }
    for name, value in rows.items():
        table.add_row(name, value)
    return table


def _split(evaluation: Evaluation) -> str:
    figures = evaluation.figures
    steps = ", ".join(map(str, evaluation.held_out_steps))
    masks = f"{figures['masks']} (privileged)" if evaluation.privileged else figures["masks"]
    return (
        f"held-out time steps {steps}, cameras {figures['cameras']}, "
        f"masks {masks or 'none'}, seed {figures['seed']}, {figures['iterations']:,} iterations"
    )


def _text(value: float | int | None, digits: int = 3) -> str:
    if value is None:
        return "–"
    return str(value) if isinstance(value, int) else f"{value:.{digits}f}"
