"""Figures for readers: a JSON file for programs, tables for people."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich import box
from rich.table import Table

from instdrive_core.evaluation.protocol import Evaluation
from instdrive_core.files.atomic import write_bytes

MAP_COLUMNS = {
    "things mIoU": "scene.miou_things",
    "scene mIoU": "scene.miou",
    "scene mAcc": "scene.macc",
    "PQ": "scene.pq",
    "Acc @.25": "scene.acc25",
    "Acc @.5": "scene.acc50",
    "ID sw.": "scene.id_switches",
    "view mIoU": "per_view.miou",
}
"""Columns of `list_map_rows`, with the protocol's keys. Things lead: what stuff is one object is a matter of opinion on
recorded clips."""
POINT_COLUMNS = {
    "AP": "ap",
    "AP50": "ap50",
    "AP25": "ap25",
    "mIoU": "miou",
    "V-meas.": "vmeasure",
    "inst. per object": "instances_per_object",
    "inst. to cover": "instances_to_cover",
    "objects per inst.": "objects_per_instance",
}
"""Columns of `list_point_rows`, with the protocol's keys."""
IMAGES_ONLY = (
    "nothing says which instance is where (no LiDAR with cuboids or semantic classes): only images are measured"
)
"""Note on a clip without ground truth."""
NOT_APPLICABLE = "–"


def write_figures(path: Path, figures: Mapping[str, Any]) -> None:
    """Write figures as one JSON object, atomically. Raises ValueError for a figure that is NaN or infinite."""
    write_bytes(path, (json.dumps(figures, indent=2, allow_nan=False) + "\n").encode())


def list_map_rows(evaluation: Evaluation) -> dict[str, list[float | int | None]]:
    """List by name how well each predicted map agrees with the ground truth; columns as `MAP_COLUMNS`.

    Reference: true IDs on this geometry. Instance: what a click selects. Codeword: of the rendered feature. The last
    rows are trivial controls.
    """
    figures = evaluation.figures
    scene = figures["scene"]
    reference = {key: scene.get(f"reference_{key}") for key in ("miou", "pq", "miou_things")}
    maps = {
        "reference": {"per_view": {}, "scene": reference},
        "instance": figures,
        "codeword": figures["codeword"],
        **evaluation.controls,
    }
    rows = {}
    for name, scores in maps.items():
        paths = (path.split(".") for path in MAP_COLUMNS.values())
        rows[name] = [scores[part].get(key) for part, key in paths]
    return rows


def build_map_table(evaluation: Evaluation) -> Table:
    """Lay out the rows of `list_map_rows` in 80 columns."""
    title = f"Instance maps, {describe_split(evaluation)}"
    table = Table(title=title, box=box.SIMPLE_HEAD, title_justify="left", pad_edge=False)
    table.add_column("predicted map", no_wrap=True)
    for name in MAP_COLUMNS:
        table.add_column(name.replace(" ", "\n"), justify="right", no_wrap=True)
    for name, values in list_map_rows(evaluation).items():
        table.add_row(name, *(format_figure(value) for value in values))
    return table


def list_point_rows(evaluation: Evaluation) -> dict[str, list[float | int | None]]:
    """List how well IDs agree with the objects of LiDAR points; rows as in `list_map_rows`, columns as `POINT_COLUMNS`.

    Empty where nothing could be measured.
    """
    lidar = evaluation.figures["lidar"]
    scores = {
        "reference": {key: lidar.get(f"reference_{key}") for key in POINT_COLUMNS.values()},
        "instance": lidar,
        **{name: control.get("lidar", {}) for name, control in evaluation.controls.items()},
    }
    rows = {name: [values.get(key) for key in POINT_COLUMNS.values()] for name, values in scores.items()}
    return rows if any(value is not None for values in rows.values() for value in values) else {}


def build_point_table(evaluation: Evaluation) -> Table | None:
    """Lay out the rows of `list_point_rows` in 80 columns; None where there are none."""
    rows = list_point_rows(evaluation)
    if not rows:
        return None
    table = Table(title="LiDAR points of held-out sweeps", box=box.SIMPLE_HEAD, title_justify="left", pad_edge=False)
    table.add_column("IDs", no_wrap=True)
    for name in POINT_COLUMNS:
        table.add_column(name.replace(" ", "\n"), justify="right", no_wrap=True)
    for name, values in rows.items():
        table.add_row(name, *(format_figure(value) for value in values))
    return table


def list_summary_rows(evaluation: Evaluation) -> dict[str, str]:
    """List images, clicks, size and cost of a run; without ground truth nothing of instances."""
    figures = evaluation.figures
    rows = {
        "PSNR (dB)": format_figure(figures["psnr"], 2),
        "PSNR in the boxes of moving objects (dB)": format_figure(figures["psnr_actors"], 2),
        "SSIM": format_figure(figures["ssim"]),
    }
    if not evaluation.has_truth:
        rows = {name: text for name, text in rows.items() if text != NOT_APPLICABLE}
    return (rows | (_list_instance_rows(figures) if evaluation.has_truth else {})) | {
        "Gaussians / instances": f"{figures['n_gaussians']:,} / {figures['n_instances']:,}",
        "training": f"{figures['train_seconds']:.0f} s, {figures['peak_rss_mb']:,.0f} MB, {figures['backend']}",
    }


def _list_instance_rows(figures: Mapping[str, Any]) -> dict[str, str]:
    click, scene = figures["click"], figures["scene"]
    return {
        "scene mIoU of things / stuff": f"{format_figure(scene['miou_things'])} / {format_figure(scene['miou_stuff'])}",
        "clicks that hit the object (IoU of the selection > 0.5)": _format_with_reference(click, "hit_rate"),
        "mean IoU of selections": _format_with_reference(click, "iou"),
        "collateral of deleting hits: other pixels changed": _format_with_reference(click, "collateral", 4),
        "residue of deleting hits: weight left in the box": _format_with_reference(click, "residue", 4),
    }


def build_summary_table(evaluation: Evaluation) -> Table:
    """Lay out the rows of `list_summary_rows`."""
    table = Table(box=box.SIMPLE, pad_edge=False, show_header=False)
    table.add_column()
    table.add_column(justify="right")
    for name, value in list_summary_rows(evaluation).items():
        table.add_row(name, value)
    return table


def describe_split(evaluation: Evaluation) -> str:
    """Say in one line what was measured on what."""
    figures = evaluation.figures
    steps = ", ".join(map(str, evaluation.held_out_steps))
    masks = f"{figures['masks']} (privileged)" if evaluation.privileged else figures["masks"]
    tracks = f"{figures['tracks']} (no labels)" if evaluation.labels_free else figures["tracks"]
    return (
        f"held-out time steps {steps}, cameras {figures['cameras']}, "
        f"masks {masks or 'none'}, tracks {tracks}, seed {figures['seed']}, {figures['iterations']:,} iterations"
    )


def format_figure(value: float | int | None, digits: int = 3) -> str:
    """Write a figure as people read it; a dash where it does not apply."""
    if value is None:
        return NOT_APPLICABLE
    return str(value) if isinstance(value, int) else f"{value:.{digits}f}"


def _format_with_reference(scores: Mapping[str, float | None], key: str, digits: int = 3) -> str:
    """Write a figure, and what true IDs reach on the same Gaussians where that is known."""
    reference = scores.get(f"reference_{key}")
    text = format_figure(scores[key], digits)
    return text if reference is None else f"{text} (reference {format_figure(reference, digits)})"
